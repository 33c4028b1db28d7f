# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A hypothesis with its scores, and the limits that were learned for them.

The limits and the temperature of the probabilities were learned on generated devices
(``piezo_stack challenge``, development seed), never on data that is withheld.
"""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Thresholds:
    """What was learned on the development set; scores in nats."""

    detect: float = 12.0  # gain of the best effect over none that counts as a gap
    sure: float = 40.0  # gain that counts as a gap even where hardly any power is left
    excess: float = 0.12  # mean square beyond that of the noise that counts as structure
    unforetold: float = 0.25  # and where neither an effect nor a flexible correction tells of it
    temperature: float = 2.5  # nats by which two effects must differ to be told apart
    occam: float = 0.2  # log odds that a number which an effect may choose costs it
    form: float = 0.01  # part of the gain by which the true form of a cause may mislead
    distrust: float = 0.1  # by which one is less likely of which a number is stuck at its bound
    explained: float = 0.55  # part of the gap that a cause must remove, pooled or by all tracks
    half: float = 0.5  # and the part pooled over the channels, where there is anything to remove
    flexible: float = 0.5  # part of what a cause leaves that a flexible correction may leave
    predicted: float = 0.5  # part of a gap within the noise that a flexible correction may remove
    believed: float = 0.5  # odds of a cause below which it is none
    trace: float = 0.05  # part removed up to which there is hardly anything
    most: float = 0.75  # part that another must remove to come before a best that is poor
    lone: float = 0.33  # part of what the best removes up to which another looks nothing like it
    second: float = 40.0  # nats that a second effect must explain where it acts
    second_form: float = 0.03  # or, if more, this part of what the first explains
    finish_form: float = 0.01  # and this where the two leave hardly anything of what one leaves
    finishes: float = 0.1  # part of what one leaves that is hardly anything
    second_part: float = 0.22  # and the part of what the first leaves there
    loses: float = 1.2  # times what one leaves of the gap that two may leave
    completes: float = 0.03  # or else part of what one leaves of the gap that two may leave
    finish_part: float = 0.1  # and this where the two leave hardly anything of what one leaves
    mended_part: float = 0.5  # and this beside a first whose form another mends
    clear: float = 50.0  # or else nats that it must explain where the first hardly acts
    clear_part: float = 0.45  # and the part of what is left there
    clear_first: float = 0.9  # where the first removes so much: else what is left may be anything
    formed: float = 250.0  # or else nats that errors of form must excuse less of two than of one
    excused: float = 40.0  # nats of these that any second must have
    half_formed: float = 150.0  # and a relative that with the first leaves less than half
    misformed: float = 0.3  # share of what the second does by which its form may be wrong
    still: float = 0.6  # part of what the first leaves, all tracks alike, that two may leave
    stays: float = 0.75  # or else, by the power of the gap
    alone: float = 0.85  # part removed by one effect beyond which no relative is its second
    formless: float = 0.95  # or below which one leaves more than its form can miss
    relative_part: float = 0.6  # and the part that a relative must explain
    relative_clear: float = 150.0  # or else nats that it must explain where the first hardly acts
    relative_clear_part: float = 0.65  # and the part of what is left there
    nearly_all: float = 0.75  # or else the part that it explains to the noise
    tenth: float = 0.1  # where it leaves this part of the loudest excess
    twentieth: float = 0.05  # or else part of what one leaves of the gap that two may leave
    unmistaken: float = 0.05  # error of the form of a second whose form is known when it is seen
    far: float = 4.0  # times the nats of ``formed`` that errors of form must then excuse less
    hushes: float = 0.01  # part of the loudest excess that it may leave, if not the noise
    halves: float = 0.45  # part of what one leaves that is less than half, however that is judged
    heard: float = 0.5  # excess over the noise power from which a recording is loud at all
    quiet_part: float = 0.4  # and the part that a second must explain that leaves the loudest so
    as_good: float = 0.85  # part of what one removes that a look-alike removes as well
    as_likely: float = 0.1  # probability, against the best pair, from which a pair ties with it
    alike_pair: float = 0.08  # part of what pairs explain by which the form may mislead
    shade: float = 0.5  # part of what a relative of the first leaves above which a pair is like it
    nearly: float = 0.8  # part of what a second explains that a relative explains about as much
    certain: float = 0.99  # part removed by one effect from which it stands for no other
    leftover: float = 0.25  # excess over the noise power that sets out for a second effect
    cover: float = 0.9  # probability that the ambiguity set is to hold
    together: float = 0.05  # probability, against the best, from which an effect is in the set
    alike: float = 3.0  # times what the best leaves that one who looks like it may leave
    alike_form: float = 0.05  # part of the gain by which the form may mislead between such two
    drive: float = 0.35  # part of what is wrong with the voltage that an effect must remove
    behind: float = 0.75  # part of the gap behind the terminals from which a second effect
    hint: float = 5.0  # need explain no more nats than this with the simulated voltage, too
    too_many: int = 9  # effects in a set from which nothing is identified
    # Log odds that one effect is the whole cause: constant, per part of the removable gap that
    # stays, per decade of what is left over the noise.
    one: tuple[float, float, float] = (3.6, -4.0, -0.5)
    two: tuple[float, float, float] = (2.5, 0.0, 0.0)  # the same for two
    left_open: float = 0.95  # by which it is less sure that the cause is among those of a tie
    nothing: float = 0.95  # how often NO_GAP is right
    unknown: float = 0.95  # and UNKNOWN
    # The best may be a known effect by another form, or there is too little left to tell.
    half_known: float = 0.33  # part that the best removes from which that is so
    faint: float = 0.8  # and the mean square beyond that of the noise up to which it is
    doubtful: float = 0.35  # how often UNKNOWN is right then
    doubtful_single: float = 0.4  # and how often one effect of the library is the whole cause


DEFAULTS = Thresholds()


@dataclass(frozen=True)
class Ranked:
    """A hypothesis with its score."""

    name: str
    gain: float  # log score over the re-tuned nominal device, nats
    removed: float  # part of the removable gap that it removes
    parameters: int
    left: float = 1.0  # part of the gap that is still left, all tracks alike
    excess: float = 0.0  # largest mean square over the noise that it leaves in a track, minus one
    second: float = 0.0  # of a pair: nats that the second effect explains where it acts
    part: float = 0.0  # and the part of what the first leaves there
    clear: float = 0.0  # and the nats where the first does less than the second
    clear_part: float = 0.0  # and the part there
    over: float = math.inf  # nats by which it is better than any single effect
    form: float = math.inf  # the same where errors of form are excused (gap/fitting/form.py)
    wrong: float = 0.0  # and the relative error of the form of the second
    spent: float = 0.0  # nats that its numbers cost: those who are free to choose fit more easily
    stuck: bool = False  # whether a number of it came to rest at its bound
    simpler: str = ''  # the hypothesis that it cannot be told from in recordings so short
    beside: Ranked | None = None  # the first with another that mends its form, if it has one

    def odds(self, learned: tuple[float, float, float], hidden: bool = False) -> float:
        """
        Return the learned probability that this is the whole cause, all rivals apart.

        Of a ``hidden`` gap, which no channel shows as a whole, there is no part to remove.
        """
        stays = min(max(self.excess if hidden else 1.0 - self.removed, 0.0), 1.0)
        total = learned[0] + learned[1] * stays + learned[2] * math.log10(
            1.0 + max(self.excess, 0.0))
        return 1.0 / (1.0 + math.exp(-total))
