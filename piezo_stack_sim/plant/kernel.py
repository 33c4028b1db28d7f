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
* inputs: u, F_ext, a_rc, 1, a_friction, a_contact, smooth voltage, smooth force;
  the ideal stack needs the first three, and only as many are worked with.
"""

import math

from numba import njit
import numpy as np

from piezo_stack_sim.plant.cubic import crossing, hermite, turning

# Inputs, in the order of their columns.
U, FORCE, A_RC, ONE, A_FRICTION, A_CONTACT, SMOOTH_V, SMOOTH_F = range(8)
N_INPUTS = 8
N_RAMPS = 2  # the two smooth inputs may change linearly within a sub-step

# Outputs: reading of displacement, velocity, charge, voltage, transduced force.
N_OUTPUTS = 5

# What is watched in every state: charge and its derivatives, the second and third
# derivative of displacement, the rate of charge that the source wants, the outputs.
W_Q, W_Q1, W_Q2, W_Q3, W_X2, W_X3, W_WANT, W_OUT = range(8)
N_WATCHED = W_OUT + N_OUTPUTS

# Real parameters of the kernel.
(R_T, R_C, R_MASS, R_STIFFNESS, R_RESISTANCE, R_INTERNAL, R_LIMIT, R_FRICTION_K,
 R_FRICTION_F, R_GAP, R_CONTACT_K, R_V2, R_V3, R_K2, R_K3, R_OMEGA_EXTRA, R_RATE_MAX,
 R_TOL, R_DAMPING) = range(19)
N_REAL = 19

# Integer parameters.
(I_DRIVE, I_QSTATE, I_FRICTION, I_CONTACT, I_LIMITER, I_SMOOTH, I_CLAMPED, I_SOURCE,
 I_INPUTS) = range(9)
N_INT = 9

# Drives.
VOLTAGE, CHARGE = 0, 1

# Discrete state: slipping Maxwell elements and their direction, the same for
# friction, contact touched, limiter (0 linear, 1 up, 2 down).
F_SLIP, F_DIR, F_FRIC, F_FRIC_DIR, F_CONTACT, F_LIMIT = range(6)
N_FLAGS = 6

CHARGE_TOLERANCE = 1e-14  # C; a millionth of the smallest break charge of interest
DISPLACEMENT_TOLERANCE = 1e-15  # m
REST = 1e-12  # C; less than this to come (0.1 pm) is rest
MAX_EVENTS = 100000  # in one segment; a guard, never met by a finite input

_jit = njit(cache=True, nogil=True, error_model='numpy')
# For what runs at every sub-step: passing a dozen arrays would cost more than the work.
_inline = njit(cache=True, nogil=True, error_model='numpy', forceinline=True)


@_inline
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
def _product(a, b, factor):
    size = a.shape[0]
    out = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            weight = a[i, j] * factor
            if weight != 0.0:
                for c in range(size):
                    out[i, c] += weight * b[j, c]
    return out


@_jit
def build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
               tables, watch, omegas, dampings):
    """
    Resolve the algebra of one mode and make its propagators.

    ``rates`` (N, N+2+8) are the derivatives of the states over extended
    signals, ``opposing`` (2, N+1) the voltage in series with the Maxwell
    capacitor and the charge lost under charge drive, both over states and q,
    ``reading`` (5, N+2+8) the outputs.
    Fills ``tables[mode]`` and ``watch[mode]`` (both with the column of the extended
    state first, so that sums over it run along memory), and the natural frequency ``omegas``
    (rad/s) and decay rate ``dampings`` (1/s) of the moving end in this mode.
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

    # Derivatives of charge and displacement while the inputs are held.
    row = np.empty(width)
    after = np.empty(width)
    for base, first, count in ((W_Q, 0, 4), (W_X2 - 2, 2, 4)):
        for c in range(width):
            row[c] = q_row[c] if base == W_Q else 0.0
        if base != W_Q:
            row[0] = 1.0
        for order in range(count):
            if order >= first:
                for c in range(width):
                    watch[mode, c, base + order] = row[c]
            for c in range(width):
                after[c] = 0.0
                for i in range(n_states):
                    after[c] += row[i] * augmented[i, c]
            row[:] = after
    for c in range(width):
        watch[mode, c, W_WANT] = want[c]
    for o in range(N_OUTPUTS):
        for c in range(n_states):
            watch[mode, c, W_OUT + o] = reading[o, c]
        for c in range(N_INPUTS):
            watch[mode, n_states + c, W_OUT + o] = reading[o, n_states + 2 + c]
        for c in range(width):
            watch[mode, c, W_OUT + o] += (reading[o, n_states] * q_row[c]
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
    dampings[mode] = -0.5 * augmented[1, 1]

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
            term = _product(term, augmented, step / order)
            e += term
        for _ in range(scaling):
            e = _product(e, e, 1.0)
        for level in range(levels[d] + 1):
            for i in range(n_states):
                for c in range(size):
                    tables[mode, d, level, c, i] = e[i, c]
            if level < levels[d]:
                e = _product(e, e, 1.0)


@_jit
def _watched(watch, mode, which, s, inputs, n_in):
    """Return one watched value."""
    total = 0.0
    n_states = s.size
    for c in range(n_states):
        total += watch[mode, c, which] * s[c]
    for c in range(n_in):
        total += watch[mode, n_states + c, which] * inputs[c]
    return total


@_inline
def _watch(watch, mode, s, inputs, n_in, out):
    """Compute all watched values of a state."""
    n_states = s.size
    for o in range(N_WATCHED):
        out[o] = 0.0
    for c in range(n_states):
        value = s[c]
        for o in range(N_WATCHED):
            out[o] += watch[mode, c, o] * value
    for c in range(n_in):
        value = inputs[c]
        for o in range(N_WATCHED):
            out[o] += watch[mode, n_states + c, o] * value


@_inline
def _propagate(tables, mode, d, level, s, inputs, n_in, out):
    """Move a state by 2**level ticks with the inputs held."""
    n_states = s.size
    for i in range(n_states):
        out[i] = 0.0
    for c in range(n_states):
        value = s[c]
        for i in range(n_states):
            out[i] += tables[mode, d, level, c, i] * value
    for c in range(n_in):
        value = inputs[c]
        for i in range(n_states):
            out[i] += tables[mode, d, level, n_states + c, i] * value


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
    slip = flags[F_SLIP]
    a = maxwell_offset(slip, flags[F_DIR], p, k, v_break)
    stiff = opposing_q
    for i in range(slip, n):
        stiff += k[i]
    value = q + slope_cap * (a + stiff * q + _smooth_voltage(q, real))
    miss = target - value
    if abs(miss) <= 1e-18:
        return q
    direction = 1 if miss > 0.0 else -1
    if slip > 0 and flags[F_DIR] != direction:
        stick(flags, p, r, q)
        slip = 0
        a = maxwell_offset(0, direction, p, k, v_break)
        stiff = opposing_q
        for i in range(n):
            stiff += k[i]
    flags[F_DIR] = direction
    while slip < n:
        edge = p[slip] + direction * r[slip]
        if not math.isfinite(edge):
            break  # an element that never slips
        if direction * (q - edge) < 0.0:
            at_edge = edge + slope_cap * (a + stiff * edge + _smooth_voltage(edge, real))
            if direction * (target - at_edge) < 0.0:
                break
            q = edge
        a += direction * v_break[slip] + k[slip] * p[slip]
        stiff -= k[slip]
        slip += 1
    flags[F_SLIP] = slip
    for _ in range(8):
        value = q + slope_cap * (a + stiff * q + _smooth_voltage(q, real))
        slope = 1.0 + slope_cap * (stiff + q * (2.0 * real[R_V2] + 3.0 * q * real[R_V3]))
        change = (target - value) / max(slope, 0.05)
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
def _process(now, s, inputs, flags, p, r, k, v_break, real, ip, x_block, turned):
    """
    Switch every port whose condition is met at this instant.

    ``turned`` says that the event search met a reversal: 1 of the charge, 2 of
    the displacement.

    Returns True if the mode changed.  ``x_block`` holds the position of the
    friction block, the furthest charge since slip began and the present charge.
    """
    n = k.size
    changed = False
    q = now[W_Q]
    x_block[2] = q
    rate = now[W_Q1]
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
        want = now[W_WANT]
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


@_inline
def _event_charge(q0, d0, q1, d1, flags, p, r, far, n, reliable):
    """
    Return the part of a sub-step after which the charge first meets an event, or 2.

    ``d0``, ``d1`` are slopes times the length, ``far`` the furthest charge of
    this slip.  The second value is 1 if the event is a reversal.  ``reliable``
    says that the sub-step is short against the fastest motion, so that the
    cubic through its ends tells what happens between them.
    """
    slip = flags[F_SLIP]
    if slip > 0:
        direction = flags[F_DIR]
        top = 2.0
        if direction * d1 < 0.0:
            if direction * d0 > 0.0:
                if direction * d0 > CHARGE_TOLERANCE or direction * (far - q1) > CHARGE_TOLERANCE:
                    top = min(1.0, turning(q0, d0, q1, d1))
            elif max(direction * far, direction * q0) - direction * q1 > CHARGE_TOLERANCE:
                return 0.0, 1
        if slip < n:
            edge = p[slip] + direction * r[slip]
            if top < 1.0:
                if direction * (hermite(top, q0, d0, q1, d1) - edge) > CHARGE_TOLERANCE:
                    return crossing(edge, q0, d0, q1, d1, top), 0
            elif direction * (q1 - edge) > CHARGE_TOLERANCE:
                return crossing(edge, q0, d0, q1, d1, 1.0), 0
        return top, 1
    high = p[0] + r[0] + CHARGE_TOLERANCE
    low = p[0] - r[0] - CHARGE_TOLERANCE
    if reliable and d0 * d1 < 0.0:
        top = turning(q0, d0, q1, d1)
        if top < 1.0:
            peak = hermite(top, q0, d0, q1, d1)
            if peak > high:
                return crossing(high, q0, d0, q1, d1, top), 0
            if peak < low:
                return crossing(low, q0, d0, q1, d1, top), 0
    if q1 > high:
        return crossing(high, q0, d0, q1, d1, 1.0), 0
    if q1 < low:
        return crossing(low, q0, d0, q1, d1, 1.0), 0
    return 2.0, 0


@_jit
def _event_displacement(x0, w0, x1, w1, flags, real, ip, x_block):
    """Return the same for friction and contact; kind 2 is a reversal of the displacement."""
    first = 2.0
    kind = 0
    top = 1.0
    if w0 * w1 < 0.0:
        top = min(1.0, turning(x0, w0, x1, w1))
    peak = hermite(top, x0, w0, x1, w1) if top < 1.0 else x1
    if ip[I_FRICTION] != 0:
        direction = flags[F_FRIC_DIR]
        if flags[F_FRIC] != 0:
            far = max(direction * x_block[3], max(direction * x0, direction * x1))
            if direction * w1 < 0.0 and (
                    direction * w0 > 0.0 or far - direction * x1 > DISPLACEMENT_TOLERANCE):
                first = top if direction * w0 > 0.0 else 0.0
                kind = 2
        else:
            reach = real[R_FRICTION_F] / real[R_FRICTION_K] + DISPLACEMENT_TOLERANCE
            for sign in (1.0, -1.0):
                edge = x_block[0] + sign * reach
                if sign * (peak - edge) > 0.0:
                    first = min(first, crossing(edge, x0, w0, x1, w1, top))
                elif sign * (x1 - edge) > 0.0:
                    first = min(first, crossing(edge, x0, w0, x1, w1, 1.0))
    if ip[I_CONTACT] != 0:
        sign = 1.0 if flags[F_CONTACT] == 0 else -1.0
        edge = real[R_GAP] + sign * DISPLACEMENT_TOLERANCE
        at = 2.0
        if sign * (peak - edge) > 0.0:
            at = crossing(edge, x0, w0, x1, w1, top)
        elif sign * (x1 - edge) > 0.0:
            at = crossing(edge, x0, w0, x1, w1, 1.0)
        if at < first:
            first = at
            kind = 0
    return first, kind


@_inline
def _grazes(y0, d0, y1, d1, low, high):
    """
    Tell whether y turns so close to an edge that the cubic cannot say on which side.

    The cubic strays by (1.3 rad)^4/384 of the ringing, 0.7 %; halving the step makes it 16 times
    better.
    """
    if d0 * d1 >= 0.0:
        return False
    top = turning(y0, d0, y1, d1)
    if top >= 1.0:
        return False
    peak = hermite(top, y0, d0, y1, d1)
    margin = 0.02 * (abs(d0) + abs(d1))
    return abs(peak - high) < margin or abs(peak - low) < margin


@_jit
def _event_limit(want0, want1, state, limit):
    """Return the part of a sub-step after which the amplifier begins or ends to limit, or 2."""
    edge = limit
    if state == 0:
        if want1 < -limit * (1.0 + 1e-9):
            edge = -limit
        elif not want1 > limit * (1.0 + 1e-9):
            return 2.0
    elif state == 1:
        if want1 >= limit:
            return 2.0
    else:
        edge = -limit
        if want1 <= -limit:
            return 2.0
    part = 1.0
    if want1 != want0:
        part = (edge - want0) / (want1 - want0)
    return min(1.0, max(0.02, part))


@_inline
def _clear(y, d1, d2, d3, omega, damping, length, low, high, exact):
    """
    Tell whether y stays within (low, high) for ``length`` seconds.

    y is split into ringing about a centre and a slow part.  The amplitude
    sqrt((y - centre)^2 + (y'/omega)^2) of a damped oscillator never grows, so
    with two states (``exact``) the bound is strict; else it gets a margin.
    """
    inverse = 1.0 / omega
    slow = d1 + (d3 + 2.0 * damping * d2) * inverse * inverse
    if exact:
        slow = 0.0
    fast = d1 - slow
    offset = -(d2 + 2.0 * damping * fast) * inverse * inverse  # of y from its centre
    radius = math.sqrt(offset * offset + fast * fast * inverse * inverse)
    top = y - offset + radius
    bottom = y - offset - radius
    if not exact:
        margin = 0.5 * radius
        top += margin + max(0.0, slow * length)
        bottom -= margin - min(0.0, slow * length)
    return top < high and bottom > low


@_jit
def _monotone(d1, d2, d3, omega, damping, direction):
    """Tell whether y goes on in ``direction``: the slow part outruns the ringing."""
    inverse = 1.0 / omega
    slow = d1 + (d3 + 2.0 * damping * d2) * inverse * inverse
    fast = d1 - slow
    swing = abs(fast) + abs(d2 + 2.0 * damping * fast) * inverse
    return direction * slow > 2.0 * swing


@_jit
def _goes_on(d1, d2, d3, omega, damping, direction, length, small, exact):
    """
    Tell whether a slip goes on in its direction, or has come to its end.

    What rings by less than a thousandth of ``small`` (C or m) is rounding: it would
    hide that nothing moves any more.
    """
    ring = (abs(d2) + abs(d3) / omega) / omega
    if ring < 1e-3 * small * omega:
        return direction * d1 >= 0.0 or abs(d1) * length < small
    if not exact and _monotone(d1, d2, d3, omega, damping, direction):
        return True
    return (abs(d1) + ring) * length + ring / omega < small


@_jit
def _calm(now, x, w, omega, damping, exact, length, flags, p, r, displaced, real, ip, x_block):
    """Tell whether a sub-step longer than the fast motion may be tried: no hidden event."""
    if ip[I_LIMITER] != 0 and (flags[F_LIMIT] != 0
                               or abs(now[W_WANT]) > 0.5 * real[R_LIMIT]):
        return False  # ringing may lead it across the limit and back
    if flags[F_SLIP] > 0:
        if not _goes_on(now[W_Q1], now[W_Q2], now[W_Q3], omega, damping, flags[F_DIR], length,
                        REST, exact):
            return False
    elif not _clear(now[W_Q], now[W_Q1], now[W_Q2], now[W_Q3], omega, damping, length,
                    p[0] - r[0] - CHARGE_TOLERANCE, p[0] + r[0] + CHARGE_TOLERANCE, exact):
        return False
    if displaced:
        if ip[I_FRICTION] != 0:
            reach = real[R_FRICTION_F] / real[R_FRICTION_K] + DISPLACEMENT_TOLERANCE
            if flags[F_FRIC] != 0:
                if not _goes_on(w, now[W_X2], now[W_X3], omega, damping, flags[F_FRIC_DIR],
                                length, 0.1 * REST, exact):
                    return False
            elif not _clear(x, w, now[W_X2], now[W_X3], omega, damping, length,
                            x_block[0] - reach, x_block[0] + reach, exact):
                return False
        if ip[I_CONTACT] != 0:
            low = -1.0
            high = real[R_GAP] + DISPLACEMENT_TOLERANCE
            if flags[F_CONTACT] != 0:
                low = real[R_GAP] - DISPLACEMENT_TOLERANCE
                high = 1.0
            if not _clear(x, w, now[W_X2], now[W_X3], omega, damping, length, low, high, exact):
                return False
    return True


@_jit
def _smooth_step(tables, watch, mode, d, level, length, s, s1, s2, inputs, ramp, real):
    """
    Let the smooth ports follow a straight line between the ends of a sub-step.

    ``s1`` holds the end state with the ports held; it is corrected in place.
    Returns by how much (V) a port strays from that line in the middle.
    """
    n_states = s.size
    width = n_states + N_INPUTS
    ramp[0] = 0.0
    ramp[1] = 0.0
    voltage = inputs[SMOOTH_V]
    force = inputs[SMOOTH_F]
    end_v = voltage
    end_f = force
    for i in range(n_states):
        s2[i] = s1[i]
    for _ in range(8):
        inputs[SMOOTH_V] = end_v
        q1 = _watched(watch, mode, W_Q, s1, inputs, N_INPUTS)
        new_v = _smooth_voltage(q1, real)
        new_f = _smooth_force(s1[0], real)
        change = abs(new_v - end_v) + abs(new_f - end_f) / real[R_T]
        end_v = new_v
        end_f = new_f
        ramp[0] = (end_v - voltage) / length
        ramp[1] = (end_f - force) / length
        for i in range(n_states):
            s1[i] = (s2[i] + tables[mode, d, level, width, i] * ramp[0]
                     + tables[mode, d, level, width + 1, i] * ramp[1])
        if change < 1e-3 * real[R_TOL]:
            break
    inputs[SMOOTH_V] = end_v
    inputs[SMOOTH_F] = end_f
    q1 = _watched(watch, mode, W_Q, s1, inputs, N_INPUTS)
    d1 = _watched(watch, mode, W_Q1, s1, inputs, N_INPUTS) * length
    inputs[SMOOTH_V] = voltage
    inputs[SMOOTH_F] = force
    q0 = _watched(watch, mode, W_Q, s, inputs, N_INPUTS)
    d0 = _watched(watch, mode, W_Q1, s, inputs, N_INPUTS) * length
    middle_q = hermite(0.5, q0, d0, q1, d1)
    middle_x = hermite(0.5, s[0], s[1] * length, s1[0], s1[1] * length)
    return (abs(_smooth_voltage(middle_q, real) - 0.5 * (voltage + end_v))
            + abs(_smooth_force(middle_x, real) - 0.5 * (force + end_f)) / real[R_T])


@_jit
def run(seg_class, seg_ticks, seg_u, seg_force, seg_state, seg_read,
        s, p, flags, inputs, x_block, k, v_break, r,
        real, ip, rates, opposing, reading, cls_tick, levels, short, built,
        tables, watch, omegas, dampings, out_state, out_read):
    """
    Advance the device over segments of constant command and force.

    ``seg_state[i]`` / ``seg_read[i]`` name the row of ``out_state`` /
    ``out_read`` (n, 5) that is sampled at the end of segment i, or -1.
    ``short[d]`` is the greatest level of class d that is short against the
    fastest motion.  ``built`` marks the modes whose propagators exist.
    Returns 0, or 1 if a state left the finite numbers.
    """
    n = k.size
    n_in = ip[I_INPUTS]
    n_states = s.size
    s1 = np.empty(n_states)
    s2 = np.empty(n_states)
    ramp = np.zeros(N_RAMPS)
    now = np.zeros(N_WATCHED)
    then = np.zeros(N_WATCHED)
    exact = n_states == 2 and ip[I_SMOOTH] == 0
    smooth = ip[I_SMOOTH] != 0
    plain = ip[I_LIMITER] == 0 and not smooth
    displaced = ip[I_FRICTION] != 0 or ip[I_CONTACT] != 0
    fresh = True  # the watched values must be computed anew
    for segment in range(seg_class.size):
        d = seg_class[segment]
        tick = cls_tick[d]
        left = seg_ticks[segment]
        unsettled = 0  # how often ports may still switch at this instant
        kind = 0
        if inputs[U] != seg_u[segment] or inputs[FORCE] != seg_force[segment]:
            inputs[U] = seg_u[segment]
            inputs[FORCE] = seg_force[segment]
            _settle(s, inputs, flags, p, r, k, v_break, real, ip, opposing, x_block)
            _offsets(inputs, flags, p, k, v_break, real, ip, x_block)
            x_block[1] = x_block[2]
            unsettled = 4
            fresh = True
            kind = 1  # a rate of charge that now points back ends the slip at once
        mode = mode_index(flags, n, ip)
        # What relaxes after a jump is met by steps that grow with the time since then.
        trust = short[d] if unsettled > 0 and not exact else levels[d]
        level = trust
        rested = 0  # events met: a guard
        blind = 0  # ticks to go without looking: to an event, or to the end
        while True:
            if not built[mode]:
                build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
                           tables, watch, omegas, dampings)
                built[mode] = True
            if fresh and blind == 0:
                _watch(watch, mode, s, inputs, n_in, now)
                fresh = False
            if unsettled > 0 and blind == 0:
                unsettled -= 1
                if _process(now, s, inputs, flags, p, r, k, v_break, real, ip, x_block,
                            kind):
                    mode = mode_index(flags, n, ip)
                    fresh = True
                else:
                    unsettled = 0
                continue
            if blind == 0:
                if left <= 0:
                    break
                while (1 << level) > left:
                    level -= 1
                if level > short[d]:
                    if exact and flags[F_SLIP] == 0 and plain and not displaced:
                        if _calm(now, s[0], s[1], omegas[mode], dampings[mode], exact,
                                 tick * left, flags, p, r, displaced, real, ip, x_block):
                            # Nothing can happen up to the end of the segment.
                            blind = left
                            unsettled = 4
                            kind = 0
                        else:
                            level = short[d]
                    else:
                        while level > short[d] and not _calm(
                                now, s[0], s[1], omegas[mode], dampings[mode], exact,
                                tick * (1 << level), flags, p, r, displaced, real, ip, x_block):
                            level = max(short[d], level - 2)
            if blind > 0:
                while (1 << level) > blind:
                    level -= 1
            count = 1 << level
            length = tick * count
            _propagate(tables, mode, d, level, s, inputs, n_in, s1)
            if blind > 0:
                if smooth:
                    width = n_states + N_INPUTS
                    for i in range(n_states):
                        s1[i] += (tables[mode, d, level, width, i] * ramp[0]
                                  + tables[mode, d, level, width + 1, i] * ramp[1])
                    inputs[SMOOTH_V] += ramp[0] * length
                    inputs[SMOOTH_F] += ramp[1] * length
                for i in range(n_states):
                    s[i] = s1[i]
                left -= count
                blind -= count
                if blind == 0:
                    fresh = True
                    trust = levels[d] if exact else short[d]
                    level = trust
                    if smooth:
                        inputs[SMOOTH_F] = _smooth_force(s[0], real)
                        inputs[SMOOTH_V] = _smooth_voltage(
                            _watched(watch, mode, W_Q, s, inputs, n_in), real)
                continue
            if smooth:
                voltage = inputs[SMOOTH_V]
                force = inputs[SMOOTH_F]
                error = _smooth_step(tables, watch, mode, d, level, length, s, s1, s2, inputs,
                                     ramp, real)
                if error > real[R_TOL] and level > 0:
                    level -= 1
                    continue
                inputs[SMOOTH_V] = voltage + ramp[0] * length
                inputs[SMOOTH_F] = force + ramp[1] * length
            _watch(watch, mode, s1, inputs, n_in, then)
            reliable = level <= short[d]
            if not reliable and (flags[F_SLIP] > 0 or flags[F_FRIC] != 0) and not _calm(
                    then, s1[0], s1[1], omegas[mode], dampings[mode], exact, length, flags, p, r,
                    displaced, real, ip, x_block):
                # What slips at the start must still slip at the end for all between to be clear.
                if smooth:
                    inputs[SMOOTH_V] = voltage
                    inputs[SMOOTH_F] = force
                level = max(short[d], level - 2)
                continue
            part, kind = _event_charge(now[W_Q], now[W_Q1] * length, then[W_Q],
                                       then[W_Q1] * length, flags, p, r, x_block[1], n, reliable)
            if displaced:
                at, other = _event_displacement(s[0], s[1] * length, s1[0], s1[1] * length,
                                                flags, real, ip, x_block)
                if at < part:
                    part = at
                    kind = other
            if ip[I_LIMITER] != 0:
                at = _event_limit(now[W_WANT], then[W_WANT], flags[F_LIMIT], real[R_LIMIT])
                if at < part:
                    part = at
                    kind = 0
            if part > 1.0 and reliable and level > 0:
                slip = flags[F_SLIP]
                if slip == 0:
                    grazing = _grazes(now[W_Q], now[W_Q1] * length, then[W_Q], then[W_Q1] * length,
                                      p[0] - r[0], p[0] + r[0])
                else:
                    grazing = False
                if not grazing and displaced:
                    if ip[I_FRICTION] != 0 and flags[F_FRIC] == 0:
                        reach = real[R_FRICTION_F] / real[R_FRICTION_K]
                        grazing = _grazes(s[0], s[1] * length, s1[0], s1[1] * length,
                                          x_block[0] - reach, x_block[0] + reach)
                    if not grazing and ip[I_CONTACT] != 0:
                        grazing = _grazes(s[0], s[1] * length, s1[0], s1[1] * length,
                                          real[R_GAP], real[R_GAP])
                if grazing:
                    if smooth:
                        inputs[SMOOTH_V] = voltage
                        inputs[SMOOTH_F] = force
                    level -= 1
                    continue
            if part <= 1.0 and rested < MAX_EVENTS:
                # An event: go back and meet it on its tick, then look again.
                if smooth:
                    inputs[SMOOTH_V] = voltage
                    inputs[SMOOTH_F] = force
                rested += 1
                if reliable:
                    blind = min(count, max(1, int(math.ceil(part * count))))
                    unsettled = 4
                else:
                    level = max(short[d], level - 3)  # too long to trust the cubic
                continue
            left -= count
            for i in range(n_states):
                s[i] = s1[i]
            for i in range(N_WATCHED):
                now[i] = then[i]
            if flags[F_SLIP] > 0 and flags[F_DIR] * (now[W_Q] - x_block[1]) > 0.0:
                x_block[1] = now[W_Q]
            if flags[F_FRIC] != 0 and flags[F_FRIC_DIR] * (s1[0] - x_block[3]) > 0.0:
                x_block[3] = s1[0]
            if trust < levels[d]:
                trust += 1
            level = trust if reliable else min(level + 1, trust)
            if smooth:
                inputs[SMOOTH_F] = _smooth_force(s[0], real)
                inputs[SMOOTH_V] = _smooth_voltage(now[W_Q], real)
                fresh = True
        x_block[2] = now[W_Q]
        if not math.isfinite(x_block[2]) or not math.isfinite(s[0]):
            return 1
        row = seg_state[segment]
        if row >= 0:
            for o in range(N_OUTPUTS):
                out_state[row, o] = now[W_OUT + o]
        row = seg_read[segment]
        if row >= 0:
            out_read[row] = now[W_OUT]
    return 0
