"""
The compiled heart of the plant: exact motion between slip events.

Between two slip events the whole device is one linear system out of a small,
known family (``MODEL.md``, trap 3): which Maxwell elements stick, whether the
guide friction sticks, whether a stop is touched, whether the amplifier limits.
Such a combination is a *mode*.  Per mode and per duration of a segment the
propagators for h, h/2, h/4, ... are made once; a segment is then one small
matrix product, and an event inside it is found from the derivatives of the
charge at the ends of a sub-step and met on a grid of *ticks* (about 60 ns).

Missing an event by a fraction of a tick is harmless: stop operators are
continuous where they begin to slip, so the error is of second order in the
tick (below 1e-12 m).

Symbols as in the paper: x displacement (m), w its velocity (m/s), q charge
(C), v_rc voltage of the Maxwell capacitor (V), T transformer ratio, C linear
capacitance.  ``p[i]`` is the block position q_bi of Eq. 16 (C) and
``r[i] = V_i C_i`` the charge at which element i breaks.

Layout of the arrays shared with :mod:`piezo_stack_sim.plant.assembly`:

* columns of an *extended* row: states | q | v | inputs;
* inputs: u, F_ext, a_rc, a_friction, a_contact, 1, smooth voltage, smooth force.
"""

import math

from numba import njit
import numpy as np

# Inputs, in the order of their columns.
U, FORCE, A_RC, A_FRICTION, A_CONTACT, ONE, SMOOTH_V, SMOOTH_F = range(8)
N_INPUTS = 8
N_RAMPS = 2  # the two smooth inputs may change linearly within a sub-step

# Outputs, in the order of their rows.
N_OUTPUTS = 5  # reading of displacement, velocity, charge, voltage, transduced force

# Real parameters of the kernel.
(R_T, R_C, R_MASS, R_STIFFNESS, R_RESISTANCE, R_INTERNAL, R_LIMIT, R_FRICTION_K,
 R_FRICTION_F, R_GAP, R_CONTACT_K, R_V2, R_V3, R_K2, R_K3, R_OMEGA_EXTRA, R_RATE_MAX,
 R_TOL) = range(18)
N_REAL = 18

# Integer parameters.
I_DRIVE, I_QSTATE, I_FRICTION, I_CONTACT, I_LIMITER, I_SMOOTH, I_CLAMPED, I_SOURCE = range(8)
N_INT = 8

# Drives.
VOLTAGE, CHARGE = 0, 1

# Discrete state: slipping Maxwell elements and their direction, the same for
# friction, contact touched, limiter (0 linear, 1 up, 2 down).
F_SLIP, F_DIR, F_FRIC, F_FRIC_DIR, F_CONTACT, F_LIMIT = range(6)
N_FLAGS = 6

CHARGE_TOLERANCE = 1e-14  # C; a millionth of the smallest break charge of interest
DISPLACEMENT_TOLERANCE = 1e-15  # m
MAX_EVENTS = 100000  # in one segment; a guard, never met by a finite input

_jit = njit(cache=True, nogil=True, error_model='numpy')


@_jit
def mode_index(flags, n, ip):
    """Return the number of the mode in which the device is."""
    index = flags[F_SLIP]
    index = index * 2 + (1 if flags[F_FRIC] != 0 else 0)
    index = index * 2 + flags[F_CONTACT]
    return index * 3 + flags[F_LIMIT]


@_jit
def maxwell_offset(slip, direction, p, k, v_break):
    """Return the part of v_rc that does not depend on q in this mode (V)."""
    a = 0.0
    for i in range(k.size):
        if i < slip:
            a += direction * v_break[i]  # Eq. 16, slipping
        else:
            a -= k[i] * p[i]  # Eq. 16, sticking
    return a


@_jit
def build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
               tables, rows, omegas):
    """
    Resolve the algebra of one mode and make its propagators.

    ``rates`` (N, N+2+8) are the derivatives of the states over extended
    signals, ``opposing`` (2, N+1) the voltage in series with the Maxwell
    capacitor and the charge lost under charge drive, both over states and q, ``reading`` (5, N+2+8) the outputs.
    Fills ``tables[mode]``, ``rows[mode]`` and ``omegas[mode]``.
    """
    n_states = rates.shape[0]
    n = k.size
    width = n_states + N_INPUTS
    limit = mode % 3
    contact = (mode // 3) % 2
    friction = (mode // 6) % 2
    slip = mode // 12
    stiff_rc = 0.0
    for i in range(slip, n):
        stiff_rc += k[i]
    big_k = stiff_rc + opposing[0, n_states]
    ratio = real[R_T]
    cap = real[R_C]

    source = np.zeros(width)
    if ip[I_SOURCE] >= 0:
        source[ip[I_SOURCE]] = 1.0
    else:
        source[n_states + U] = 1.0

    q_row = np.zeros(width)
    iq = ip[I_QSTATE]
    if iq >= 0:
        q_row[iq] = 1.0
    elif ip[I_DRIVE] == VOLTAGE:
        # Eqs. 11 and 12 solved for q with v_rc = a + K q.
        scale = 1.0 / (1.0 + cap * big_k)
        for c in range(width):
            q_row[c] = cap * source[c]
        for c in range(n_states):
            q_row[c] -= cap * opposing[0, c]
        q_row[0] += ratio
        q_row[n_states + A_RC] -= cap
        q_row[n_states + SMOOTH_V] -= cap
        for c in range(width):
            q_row[c] *= scale
    else:
        for c in range(width):
            q_row[c] = source[c]
        for c in range(n_states):
            q_row[c] -= opposing[1, c]

    # v_t = (q - T x) / C, Eq. 11;  v_rc of Eq. 13 with all that is in series.
    v_row = np.zeros(width)
    for c in range(width):
        v_row[c] = q_row[c] * (1.0 / cap + big_k)
    v_row[0] -= ratio / cap
    for c in range(n_states):
        v_row[c] += opposing[0, c]
    v_row[n_states + A_RC] += 1.0
    v_row[n_states + SMOOTH_V] += 1.0

    # Rate of q wanted by the source resistance, before any limit.
    want = np.zeros(width)
    if iq >= 0:
        total = real[R_RESISTANCE] + real[R_INTERNAL]
        for c in range(width):
            want[c] = (source[c] - v_row[c]) / total
        if limit == 0:
            for c in range(width):
                v_row[c] += real[R_INTERNAL] * want[c]
        else:
            v_row[n_states + ONE] += real[R_INTERNAL] * (
                real[R_LIMIT] if limit == 1 else -real[R_LIMIT])
    elif ip[I_DRIVE] == VOLTAGE:
        for c in range(width):
            v_row[c] = source[c]

    augmented = np.zeros((width + N_RAMPS, width + N_RAMPS))
    for i in range(n_states):
        for c in range(n_states):
            augmented[i, c] = rates[i, c]
        for c in range(N_INPUTS):
            augmented[i, n_states + c] = rates[i, n_states + 2 + c]
        for c in range(width):
            augmented[i, c] += rates[i, n_states] * q_row[c] + rates[i, n_states + 1] * v_row[c]
    if iq >= 0:
        if limit == 0:
            for c in range(width):
                augmented[iq, c] = want[c]
        else:
            for c in range(width):
                augmented[iq, c] = 0.0
            augmented[iq, n_states + ONE] = real[R_LIMIT] if limit == 1 else -real[R_LIMIT]
    if ip[I_CLAMPED] == 0:
        if ip[I_FRICTION] != 0 and friction == 0:
            augmented[1, 0] -= real[R_FRICTION_K] / real[R_MASS]
        if contact == 1:
            augmented[1, 0] -= real[R_CONTACT_K] / real[R_MASS]
    for ramp in range(N_RAMPS):
        augmented[n_states + SMOOTH_V + ramp, width + ramp] = 1.0

    # Rows watched by the event search: q, q', q'', q''', x, x', x'', x''', wanted rate.
    for c in range(width):
        rows[mode, 0, c] = q_row[c]
        rows[mode, 8, c] = want[c]
    rows[mode, 4, 0] = 1.0
    for base in (0, 4):
        for order in range(1, 4):
            for c in range(width):
                total_c = 0.0
                for i in range(n_states):
                    total_c += rows[mode, base + order - 1, i] * augmented[i, c]
                rows[mode, base + order, c] = total_c
    for o in range(N_OUTPUTS):
        for c in range(n_states):
            rows[mode, 9 + o, c] = reading[o, c]
        for c in range(N_INPUTS):
            rows[mode, 9 + o, n_states + c] = reading[o, n_states + 2 + c]
        for c in range(width):
            rows[mode, 9 + o, c] += (reading[o, n_states] * q_row[c]
                                     + reading[o, n_states + 1] * v_row[c])

    spring = real[R_STIFFNESS]
    if iq >= 0 or ip[I_DRIVE] == VOLTAGE:
        spring += ratio * ratio * big_k / (1.0 + cap * big_k)  # Eq. 21
    else:
        spring += ratio * ratio / cap  # Eq. 20
    if friction == 0:
        spring += real[R_FRICTION_K] * ip[I_FRICTION]
    if contact == 1:
        spring += real[R_CONTACT_K]
    omega = math.sqrt(max(spring, 1.0) / real[R_MASS])
    if real[R_OMEGA_EXTRA] > 0.0:
        omega = min(omega, real[R_OMEGA_EXTRA])
    omegas[mode] = omega

    size = width + N_RAMPS
    for d in range(cls_tick.size):
        # The propagator of one tick by Taylor series, scaled until it converges fast.
        scaling = 0
        step = cls_tick[d]
        while step * real[R_RATE_MAX] > 0.25:
            step *= 0.5
            scaling += 1
        e = np.eye(size)
        term = np.eye(size)
        for order in range(1, 13):
            term = (term @ augmented) * (step / order)
            e += term
        for _ in range(scaling):
            e = e @ e
        for level in range(levels[d] + 1):
            for i in range(n_states):
                for c in range(size):
                    tables[mode, d, level, i, c] = e[i, c]
            if level < levels[d]:
                e = e @ e


@_jit
def _dot(rows, mode, row, s, inputs):
    total = 0.0
    n_states = s.size
    for c in range(n_states):
        total += rows[mode, row, c] * s[c]
    for c in range(N_INPUTS):
        total += rows[mode, row, n_states + c] * inputs[c]
    return total


@_jit
def _propagate(table, s, inputs, out):
    n_states = s.size
    for i in range(n_states):
        total = 0.0
        for c in range(n_states):
            total += table[i, c] * s[c]
        for c in range(N_INPUTS):
            total += table[i, n_states + c] * inputs[c]
        out[i] = total


@_jit
def _hermite(theta, y0, d0, y1, d1):
    """Cubic through the ends of a sub-step; d0, d1 are slopes times its length."""
    t2 = theta * theta
    t3 = t2 * theta
    return ((2.0 * t3 - 3.0 * t2 + 1.0) * y0 + (t3 - 2.0 * t2 + theta) * d0
            + (3.0 * t2 - 2.0 * t3) * y1 + (t3 - t2) * d1)


@_jit
def _turning(y0, d0, y1, d1):
    """Return where in (0, 1) the cubic turns, or 2 if it does not."""
    a = 6.0 * (y0 - y1) + 3.0 * (d0 + d1)
    b = 6.0 * (y1 - y0) - 4.0 * d0 - 2.0 * d1
    c = d0
    best = 2.0
    if abs(a) < 1e-12 * (abs(b) + abs(c)):
        if b != 0.0:
            root = -c / b
            if 0.0 < root < 1.0:
                best = root
        return best
    disc = b * b - 4.0 * a * c
    if disc < 0.0:
        return best
    disc = math.sqrt(disc)
    half = -0.5 * (b + (disc if b >= 0.0 else -disc))
    root = half / a
    if 0.0 < root < 1.0:
        best = root
    if half != 0.0:
        root = c / half
        if 0.0 < root < 1.0 and root < best:
            best = root
    return best


@_jit
def _crossing(level, y0, d0, y1, d1, upper):
    """Return where the cubic first reaches ``level`` in (0, upper]."""
    low = 0.0
    high = upper
    rising = _hermite(upper, y0, d0, y1, d1) > level
    for _ in range(14):
        middle = 0.5 * (low + high)
        if (_hermite(middle, y0, d0, y1, d1) > level) == rising:
            high = middle
        else:
            low = middle
    return high


@_jit
def _smooth_voltage(q, real):
    return q * q * (real[R_V2] + real[R_V3] * q)


@_jit
def _smooth_force(x, real):
    return -x * x * (real[R_K2] + real[R_K3] * x)


@_jit
def stick(flags, p, r, q):
    """Stop all slip at charge ``q``: the blocks stay where they are (Eq. 16)."""
    for i in range(flags[F_SLIP]):
        p[i] = q - flags[F_DIR] * r[i]
    flags[F_SLIP] = 0


@_jit
def move_charge(q0, target, slope_cap, real, flags, p, r, k, v_break, opposing_q):
    """
    Move the charge at once until q + C v_rc(q) reaches ``target`` (Eqs. 11, 12).

    A monotone piecewise-linear (with a smooth part: piecewise cubic) function
    is inverted by walking its breaks.  With ``slope_cap`` zero the target is
    the charge itself.  Returns the new charge; ``flags`` and ``p`` follow.
    """
    n = k.size
    q = q0
    a = maxwell_offset(flags[F_SLIP], flags[F_DIR], p, k, v_break)
    stiff = opposing_q
    for i in range(flags[F_SLIP], n):
        stiff += k[i]
    value = q + slope_cap * (a + stiff * q + _smooth_voltage(q, real))
    miss = target - value
    if abs(miss) <= 1e-18:
        return q
    direction = 1 if miss > 0.0 else -1
    if flags[F_SLIP] > 0 and flags[F_DIR] != direction:
        stick(flags, p, r, q)
    flags[F_DIR] = direction
    while True:
        slip = flags[F_SLIP]
        a = maxwell_offset(slip, direction, p, k, v_break)
        stiff = opposing_q
        for i in range(slip, n):
            stiff += k[i]
        if slip < n:
            edge = p[slip] + direction * r[slip]
            at_edge = edge + slope_cap * (a + stiff * edge + _smooth_voltage(edge, real))
            if direction * (target - at_edge) >= 0.0 or direction * (q - edge) >= 0.0:
                flags[F_SLIP] = slip + 1
                q = edge if direction * (edge - q) > 0.0 else q
                continue
        for _ in range(8):
            value = q + slope_cap * (a + stiff * q + _smooth_voltage(q, real))
            slope = 1.0 + slope_cap * (stiff + q * (2.0 * real[R_V2] + 3.0 * q * real[R_V3]))
            if slope < 0.05:
                slope = 0.05
            change = (target - value) / slope
            q += change
            if abs(change) < 1e-19 + 1e-15 * abs(q) or (real[R_V2] == 0.0 and real[R_V3] == 0.0):
                break
        return q


@_jit
def _settle(s, inputs, flags, p, r, k, v_break, real, ip, opposing, x_block):
    """
    Bring the algebraic part in line after the inputs jumped.

    With an ideal voltage source the charge jumps, with charge drive it is
    given; with a source resistance only the rate of charge jumps.
    """
    n_states = s.size
    if ip[I_SMOOTH] != 0:
        inputs[SMOOTH_F] = _smooth_force(s[0], real)
    source = s[ip[I_SOURCE]] if ip[I_SOURCE] >= 0 else inputs[U]
    iq = ip[I_QSTATE]
    q = x_block[2]
    if iq >= 0:
        q = s[iq]
    elif ip[I_DRIVE] == VOLTAGE:
        free = source
        for c in range(n_states):
            free -= opposing[0, c] * s[c]
        q = move_charge(q, real[R_T] * s[0] + real[R_C] * free, real[R_C], real, flags, p, r,
                        k, v_break, opposing[0, n_states])
    else:
        given = source
        for c in range(n_states):
            given -= opposing[1, c] * s[c]
        q = move_charge(q, given, 0.0, real, flags, p, r, k, v_break, 0.0)
    x_block[2] = q
    inputs[A_RC] = maxwell_offset(flags[F_SLIP], flags[F_DIR], p, k, v_break)
    if ip[I_SMOOTH] != 0:
        inputs[SMOOTH_V] = _smooth_voltage(q, real)


@_jit
def _offsets(inputs, flags, p, k, v_break, real, ip, x_block):
    """Offsets of the piecewise-linear ports in the present mode."""
    inputs[A_RC] = maxwell_offset(flags[F_SLIP], flags[F_DIR], p, k, v_break)
    if ip[I_FRICTION] != 0:
        if flags[F_FRIC] == 0:
            inputs[A_FRICTION] = real[R_FRICTION_K] * x_block[0]
        else:
            inputs[A_FRICTION] = -flags[F_FRIC_DIR] * real[R_FRICTION_F]
    if ip[I_CONTACT] != 0:
        inputs[A_CONTACT] = real[R_CONTACT_K] * real[R_GAP] if flags[F_CONTACT] else 0.0


@_jit
def _process(mode, rows, s, inputs, flags, p, r, k, v_break, real, ip, x_block, turned):
    """
    Switch every port whose condition is met at this instant.

    ``turned`` says that the event search met a reversal: 1 of the charge, 2 of
    the displacement.

    Returns True if the mode changed.  ``x_block`` holds the position of the
    friction block, the furthest charge since slip began and the present charge.
    """
    n = k.size
    changed = False
    q = _dot(rows, mode, 0, s, inputs)
    x_block[2] = q
    rate = _dot(rows, mode, 1, s, inputs)
    if flags[F_SLIP] > 0:
        direction = flags[F_DIR]
        if direction * (q - x_block[1]) > 0.0:
            x_block[1] = q
        if direction * rate < 0.0 and (
                turned == 1 or direction * (x_block[1] - q) > CHARGE_TOLERANCE):
            stick(flags, p, r, q)
            changed = True
    if flags[F_SLIP] == 0:
        if q > p[0] + r[0] + CHARGE_TOLERANCE:
            flags[F_DIR] = 1
            flags[F_SLIP] = 1
            x_block[1] = q
            changed = True
        elif q < p[0] - r[0] - CHARGE_TOLERANCE:
            flags[F_DIR] = -1
            flags[F_SLIP] = 1
            x_block[1] = q
            changed = True
    if flags[F_SLIP] > 0:
        direction = flags[F_DIR]
        while (flags[F_SLIP] < n
               and direction * (q - p[flags[F_SLIP]]) > r[flags[F_SLIP]] + CHARGE_TOLERANCE):
            flags[F_SLIP] += 1
            changed = True

    if ip[I_FRICTION] != 0:
        x = s[0]
        reach = real[R_FRICTION_F] / real[R_FRICTION_K]
        if flags[F_FRIC] != 0:
            if flags[F_FRIC_DIR] * (x - x_block[3]) > 0.0:
                x_block[3] = x
            if flags[F_FRIC_DIR] * s[1] < 0.0 and (
                    turned == 2
                    or flags[F_FRIC_DIR] * (x_block[3] - x) > DISPLACEMENT_TOLERANCE):
                x_block[0] = x - flags[F_FRIC_DIR] * reach
                flags[F_FRIC] = 0
                changed = True
        elif abs(x - x_block[0]) > reach + DISPLACEMENT_TOLERANCE:
            flags[F_FRIC] = 1
            flags[F_FRIC_DIR] = 1 if x > x_block[0] else -1
            x_block[3] = x
            changed = True
    if ip[I_CONTACT] != 0:
        touch = flags[F_CONTACT]
        if touch == 0 and s[0] > real[R_GAP] + DISPLACEMENT_TOLERANCE:
            flags[F_CONTACT] = 1
            changed = True
        elif touch == 1 and s[0] < real[R_GAP] - DISPLACEMENT_TOLERANCE:
            flags[F_CONTACT] = 0
            changed = True
    if ip[I_LIMITER] != 0:
        want = _dot(rows, mode, 8, s, inputs)
        limit = real[R_LIMIT]
        state = 0
        if want > limit * (1.0 + 1e-9):
            state = 1
        elif want < -limit * (1.0 + 1e-9):
            state = 2
        if state != flags[F_LIMIT]:
            flags[F_LIMIT] = state
            changed = True
    if changed:
        _offsets(inputs, flags, p, k, v_break, real, ip, x_block)
    return changed


@_jit
def _event(mode, rows, s, s1, inputs, length, flags, p, r, real, ip, x_block, n, reliable):
    """
    Return the part of the sub-step after which the first event happens, or 2, and its kind.

    The kind is 1 for a reversal of the charge, 2 for one of the displacement, else 0.

    ``reliable`` says that the sub-step is short against the fastest motion, so
    that the cubic through its ends tells what happens between them.
    """
    first = 2.0
    kind = 0
    q0 = _dot(rows, mode, 0, s, inputs)
    q1 = _dot(rows, mode, 0, s1, inputs)
    d0 = _dot(rows, mode, 1, s, inputs) * length
    d1 = _dot(rows, mode, 1, s1, inputs) * length
    if flags[F_SLIP] > 0:
        direction = flags[F_DIR]
        top = 1.0
        far = max(direction * x_block[1], max(direction * q0, direction * q1))
        turned = direction * d1 < 0.0 and far - direction * q1 > CHARGE_TOLERANCE
        if not turned and direction * d1 < 0.0 and direction * d0 > 0.0:
            turned = direction * d0 > CHARGE_TOLERANCE
        if turned:
            top = _turning(q0, d0, q1, d1)
            if top > 1.0:
                # The search began beyond the turning point, or met it at the very end.
                top = 0.0 if direction * d0 <= 0.0 else 1.0
            first = top
            kind = 1
        if flags[F_SLIP] < n:
            edge = p[flags[F_SLIP]] + direction * r[flags[F_SLIP]]
            reach = direction * (_hermite(top, q0, d0, q1, d1) - edge)
            if top == 1.0:
                reach = direction * (q1 - edge)
            if reach > CHARGE_TOLERANCE:
                first = min(first, _crossing(edge, q0, d0, q1, d1, top))
                kind = 0
    else:
        high = p[0] + r[0] + CHARGE_TOLERANCE
        low = p[0] - r[0] - CHARGE_TOLERANCE
        if q1 > high:
            first = min(first, _crossing(high, q0, d0, q1, d1, 1.0))
        elif q1 < low:
            first = min(first, _crossing(low, q0, d0, q1, d1, 1.0))
        if reliable and d0 * d1 < 0.0:
            top = _turning(q0, d0, q1, d1)
            if top < 1.0:
                peak = _hermite(top, q0, d0, q1, d1)
                if peak > high:
                    first = min(first, _crossing(high, q0, d0, q1, d1, top))
                elif peak < low:
                    first = min(first, _crossing(low, q0, d0, q1, d1, top))
    if ip[I_FRICTION] != 0 or ip[I_CONTACT] != 0:
        x0 = s[0]
        x1 = s1[0]
        w0 = s[1] * length
        w1 = s1[1] * length
        top = 1.0
        if w0 * w1 < 0.0:
            top = min(1.0, _turning(x0, w0, x1, w1))
        peak = _hermite(top, x0, w0, x1, w1) if top < 1.0 else x1
        if ip[I_FRICTION] != 0:
            if flags[F_FRIC] != 0:
                far = max(flags[F_FRIC_DIR] * x_block[3],
                          max(flags[F_FRIC_DIR] * x0, flags[F_FRIC_DIR] * x1))
                if (flags[F_FRIC_DIR] * w1 < 0.0
                        and (far - flags[F_FRIC_DIR] * x1 > DISPLACEMENT_TOLERANCE)):
                    if flags[F_FRIC_DIR] * w0 <= 0.0:
                        top = 0.0
                    if top < first:
                        first = top
                        kind = 2
            else:
                reach = real[R_FRICTION_F] / real[R_FRICTION_K] + DISPLACEMENT_TOLERANCE
                for which in range(2):
                    edge = x_block[0] + reach if which == 0 else x_block[0] - reach
                    sign = 1.0 if which == 0 else -1.0
                    if sign * (peak - edge) > 0.0:
                        first = min(first, _crossing(edge, x0, w0, x1, w1, top))
                    elif sign * (x1 - edge) > 0.0:
                        first = min(first, _crossing(edge, x0, w0, x1, w1, 1.0))
        if ip[I_CONTACT] != 0:
            gap = real[R_GAP]
            if flags[F_CONTACT] == 0:
                edge = gap + DISPLACEMENT_TOLERANCE
                if peak > edge:
                    first = min(first, _crossing(edge, x0, w0, x1, w1, top))
                elif x1 > edge:
                    first = min(first, _crossing(edge, x0, w0, x1, w1, 1.0))
            else:
                edge = gap - DISPLACEMENT_TOLERANCE
                if peak < edge:
                    first = min(first, _crossing(edge, x0, w0, x1, w1, top))
                elif x1 < edge:
                    first = min(first, _crossing(edge, x0, w0, x1, w1, 1.0))
    if ip[I_LIMITER] != 0:
        limit = real[R_LIMIT]
        want0 = _dot(rows, mode, 8, s, inputs)
        want1 = _dot(rows, mode, 8, s1, inputs)
        state = flags[F_LIMIT]
        edge = limit
        over = False
        if state == 0:
            if want1 > limit * (1.0 + 1e-9):
                over = True
            elif want1 < -limit * (1.0 + 1e-9):
                over = True
                edge = -limit
        elif state == 1:
            over = want1 < limit
        else:
            over = want1 > -limit
            edge = -limit
        if over:
            part = 1.0
            if want1 != want0:
                part = (edge - want0) / (want1 - want0)
            first = min(first, min(1.0, max(0.02, part)))
    return first, kind


@_jit
def _calm(mode, rows, omegas, s, inputs, length, flags, p, r, ip, real, x_block, n):
    """
    Tell whether a sub-step longer than the fast motion may be tried.

    The motion is split into a slow part and ringing, both bounded from the
    first three derivatives; the bounds must keep clear of every event.
    """
    omega = omegas[mode]
    q = _dot(rows, mode, 0, s, inputs)
    d1 = _dot(rows, mode, 1, s, inputs)
    d2 = _dot(rows, mode, 2, s, inputs)
    d3 = _dot(rows, mode, 3, s, inputs)
    inverse = 1.0 / omega
    slow = d1 + d3 * inverse * inverse
    ring = (abs(d2) + abs(d3) * inverse) * inverse
    swing = 3.0 * ring * inverse + CHARGE_TOLERANCE
    drift = (abs(slow) + 0.3 * ring) * length
    if flags[F_SLIP] > 0:
        if not flags[F_DIR] * slow > 3.0 * ring:
            return False
    else:
        if q + swing + drift > p[0] + r[0] and slow * length + swing > 0.0:
            if ring > CHARGE_TOLERANCE * omega or abs(slow) * length > r[0]:
                return False
        if q - swing - drift < p[0] - r[0] and slow * length - swing < 0.0:
            if ring > CHARGE_TOLERANCE * omega or abs(slow) * length > r[0]:
                return False
    if ip[I_FRICTION] != 0 or ip[I_CONTACT] != 0:
        d2 = _dot(rows, mode, 6, s, inputs)
        d3 = _dot(rows, mode, 7, s, inputs)
        slow = s[1] + d3 * inverse * inverse
        ring = (abs(d2) + abs(d3) * inverse) * inverse
        swing = 3.0 * ring * inverse + DISPLACEMENT_TOLERANCE
        drift = (abs(slow) + 0.3 * ring) * length
        if ip[I_FRICTION] != 0:
            if flags[F_FRIC] != 0:
                if not flags[F_FRIC_DIR] * slow > 3.0 * ring:
                    return False
            else:
                reach = real[R_FRICTION_F] / real[R_FRICTION_K]
                if abs(s[0] - x_block[0]) + swing + drift > reach:
                    if ring > DISPLACEMENT_TOLERANCE * omega or abs(slow) * length > reach:
                        return False
        if ip[I_CONTACT] != 0 and abs(s[0] - real[R_GAP]) < swing + drift:
            if ring > DISPLACEMENT_TOLERANCE * omega:
                return False
    return True


@_jit
def run(seg_class, seg_ticks, seg_u, seg_force, seg_state, seg_read,
        s, p, flags, inputs, x_block, k, v_break, r,
        real, ip, rates, opposing, reading, cls_tick, levels, short, built,
        tables, rows, omegas, out_state, out_read):
    """
    Advance the device over segments of constant command and force.

    ``seg_state[i]`` / ``seg_read[i]`` name the row of ``out_state`` /
    ``out_read`` (n, 5) that is sampled at the end of segment i, or -1.
    ``short[d]`` is the greatest level of class d that is short against the
    fastest motion.  ``built`` marks the modes whose propagators exist.
    Returns 0, or 1 if a state left the finite numbers.
    """
    n = k.size
    n_states = s.size
    s1 = np.empty(n_states)
    s2 = np.empty(n_states)
    ramp = np.zeros(N_RAMPS)
    smooth = ip[I_SMOOTH] != 0
    for segment in range(seg_class.size):
        d = seg_class[segment]
        tick = cls_tick[d]
        top = levels[d]
        jumped = inputs[U] != seg_u[segment] or inputs[FORCE] != seg_force[segment]
        inputs[U] = seg_u[segment]
        inputs[FORCE] = seg_force[segment]
        mode = mode_index(flags, n, ip)
        if jumped:
            _settle(s, inputs, flags, p, r, k, v_break, real, ip, opposing, x_block)
            _offsets(inputs, flags, p, k, v_break, real, ip, x_block)
            x_block[1] = x_block[2]
            mode = mode_index(flags, n, ip)
            for _ in range(4):
                if not built[mode]:
                    build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
                               tables, rows, omegas)
                    built[mode] = True
                # A rate that now points back ends the slip at once.
                if flags[F_SLIP] > 0:
                    rate = _dot(rows, mode, 1, s, inputs)
                    if flags[F_DIR] * rate < 0.0:
                        stick(flags, p, r, x_block[2])
                        _offsets(inputs, flags, p, k, v_break, real, ip, x_block)
                        mode = mode_index(flags, n, ip)
                        continue
                if not _process(mode, rows, s, inputs, flags, p, r, k, v_break, real, ip,
                                x_block, 0):
                    break
                mode = mode_index(flags, n, ip)
        left = seg_ticks[segment]
        level = top
        guard = 0
        while left > 0:
            if not built[mode]:
                build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
                           tables, rows, omegas)
                built[mode] = True
            if level > top:
                level = top
            while (1 << level) > left:
                level -= 1
            if level > short[d] and not _calm(mode, rows, omegas, s, inputs, tick * (1 << level),
                                              flags, p, r, ip, real, x_block, n):
                level = short[d]
                while (1 << level) > left:
                    level -= 1
            count = 1 << level
            table = tables[mode, d, level]
            _propagate(table, s, inputs, s1)
            if smooth:
                # The smooth ports follow a straight line between the ends of a sub-step.
                length = tick * count
                ramp[0] = 0.0
                ramp[1] = 0.0
                width = n_states + N_INPUTS
                voltage = inputs[SMOOTH_V]
                force = inputs[SMOOTH_F]
                end_v = voltage
                end_f = force
                for i in range(n_states):
                    s2[i] = s1[i]
                for _ in range(6):
                    inputs[SMOOTH_V] = end_v
                    q1 = _dot(rows, mode, 0, s1, inputs)
                    inputs[SMOOTH_V] = voltage
                    new_v = _smooth_voltage(q1, real)
                    new_f = _smooth_force(s1[0], real)
                    change = abs(new_v - end_v) + abs(new_f - end_f) / real[R_T]
                    end_v = new_v
                    end_f = new_f
                    ramp[0] = (end_v - voltage) / length
                    ramp[1] = (end_f - force) / length
                    for i in range(n_states):
                        s1[i] = (s2[i] + table[i, width] * ramp[0]
                                 + table[i, width + 1] * ramp[1])
                    if change < 1e-3 * real[R_TOL]:
                        break
                # Is a straight line good enough?  Compare at the middle of the sub-step.
                q0 = _dot(rows, mode, 0, s, inputs)
                d0 = _dot(rows, mode, 1, s, inputs) * length
                inputs[SMOOTH_V] = end_v
                inputs[SMOOTH_F] = end_f
                q1 = _dot(rows, mode, 0, s1, inputs)
                d1 = _dot(rows, mode, 1, s1, inputs) * length
                inputs[SMOOTH_V] = voltage
                inputs[SMOOTH_F] = force
                middle_q = _hermite(0.5, q0, d0, q1, d1)
                middle_x = _hermite(0.5, s[0], s[1] * length, s1[0], s1[1] * length)
                error = (abs(_smooth_voltage(middle_q, real) - 0.5 * (voltage + end_v))
                         + abs(_smooth_force(middle_x, real) - 0.5 * (force + end_f))
                         / real[R_T])
                if error > real[R_TOL] and level > 0 and guard < MAX_EVENTS:
                    level -= 1
                    guard += 1
                    continue
            part, kind = _event(mode, rows, s, s1, inputs, tick * count, flags, p, r, real, ip,
                          x_block, n, level <= short[d])
            done = count
            event = part <= 1.0
            if event and guard < MAX_EVENTS:
                guard += 1
                if level > short[d]:
                    # Too long to trust the cubic: come closer first.
                    level = max(short[d], level - 3)
                    continue
                done = int(math.ceil(part * count))
                if done < 1:
                    done = 1
                if done < count:
                    for i in range(n_states):
                        s1[i] = s[i]
                    bit = 0
                    while (1 << bit) <= done:
                        if done & (1 << bit):
                            table = tables[mode, d, bit]
                            _propagate(table, s1, inputs, s2)
                            if smooth:
                                for i in range(n_states):
                                    s2[i] += (table[i, n_states + N_INPUTS] * ramp[0]
                                              + table[i, n_states + N_INPUTS + 1] * ramp[1])
                                inputs[SMOOTH_V] += ramp[0] * tick * (1 << bit)
                                inputs[SMOOTH_F] += ramp[1] * tick * (1 << bit)
                            for i in range(n_states):
                                s1[i] = s2[i]
                        bit += 1
            for i in range(n_states):
                s[i] = s1[i]
            if smooth:
                inputs[SMOOTH_F] = _smooth_force(s[0], real)
                if done == count:
                    inputs[SMOOTH_V] += ramp[0] * tick * count
                q1 = _dot(rows, mode, 0, s, inputs)
                inputs[SMOOTH_V] = _smooth_voltage(q1, real)
            left -= done
            if event:
                for _ in range(4):
                    if not _process(mode, rows, s, inputs, flags, p, r, k, v_break, real, ip,
                                    x_block, kind):
                        break
                    mode = mode_index(flags, n, ip)
                    if not built[mode]:
                        build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick,
                                   levels, tables, rows, omegas)
                        built[mode] = True
                level = min(top, short[d])
            else:
                if flags[F_SLIP] > 0:
                    q1 = _dot(rows, mode, 0, s, inputs)
                    if flags[F_DIR] * (q1 - x_block[1]) > 0.0:
                        x_block[1] = q1
                if flags[F_FRIC] != 0 and flags[F_FRIC_DIR] * (s[0] - x_block[3]) > 0.0:
                    x_block[3] = s[0]
                level = top
        if not built[mode]:
            build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
                       tables, rows, omegas)
            built[mode] = True
        x_block[2] = _dot(rows, mode, 0, s, inputs)
        if not math.isfinite(x_block[2]) or not math.isfinite(s[0]):
            return 1
        row = seg_state[segment]
        if row >= 0:
            for o in range(N_OUTPUTS):
                out_state[row, o] = _dot(rows, mode, 9 + o, s, inputs)
        row = seg_read[segment]
        if row >= 0:
            out_read[row] = _dot(rows, mode, 9, s, inputs)
    return 0
