"""The parameters of the phase model `default`, estimated from demonstrations.

Durations, and the frequencies of ends and interruptions of a phase, were counted on the segments found in
wiping, peeling, screwing, pouring, contour and peg tasks of the simulated development persons (seeds 1 to 6),
and rounded. A cycle is rare; it is long, and its end is near its beginning. After their first round, two
wipes of a rim in `icsc` and the circles of these persons retrace all of their path, and peels at least 0.88
of it. A whole recording of `delft` retraces at most 0.22.
"""

from __future__ import annotations

from dataclasses import replace

from caesura_service.phases.model import LogNormal, Parameters, PhaseKind

FREE = PhaseKind(
    name="free",
    own=(0.996, 0.002, 0.002),
    aside=(0.02, 0.49, 0.49),
    own_s=LogNormal(0.9, 0.65),
    aside_s=LogNormal(0.4, 0.7),
    ends=0.40,
    interrupted=0.02,
    resumed=0.5,
    repeats=0.0,
    retraces=False,
    bounds=0.9,
    moving=0.65,
    step_m=0.12,
    weight=1.0,
)
CONTACT = PhaseKind(
    name="contact",
    own=(0.002, 0.996, 0.002),
    aside=(0.97, 0.01, 0.02),
    own_s=LogNormal(0.8, 0.9),
    aside_s=LogNormal(0.6, 0.85),
    ends=0.16,
    interrupted=0.13,
    resumed=0.45,
    repeats=0.8,
    retraces=False,
    bounds=0.05,
    moving=0.5,
    step_m=0.12,
    weight=1.0,
)
TRANSPORT = PhaseKind(
    name="transport",
    own=(0.002, 0.002, 0.996),
    aside=(0.70, 0.29, 0.01),
    own_s=LogNormal(1.2, 0.6),
    aside_s=LogNormal(0.5, 0.7),
    ends=0.20,
    interrupted=0.07,
    resumed=0.6,
    repeats=0.0,
    retraces=False,
    bounds=0.05,
    moving=0.75,
    step_m=0.12,
    weight=1.0,
)
CYCLE = PhaseKind(
    name="cycle",
    own=(0.996, 0.002, 0.002),
    aside=(0.02, 0.49, 0.49),
    own_s=LogNormal(4.0, 0.9),
    aside_s=LogNormal(0.4, 0.7),
    ends=0.3,
    interrupted=0.02,
    resumed=0.5,
    repeats=0.0,
    retraces=True,
    bounds=0.02,
    moving=0.6,
    step_m=0.05,
    weight=0.1,
)
# Strokes that go to and fro: a cycle whose strokes are those of a contact.
STROKES = replace(CYCLE, own_s=CONTACT.own_s, step_m=CONTACT.step_m, moving=CONTACT.moving, ends=CONTACT.ends)
# The priors are those of the preset `default`: three segments in a hundred are loads. Of the changepoints
# that are found on the development people's skills, 0.09 are false: so is the share of pieces, rounded. A
# demonstration of these people has 16 segments.
PARAMETERS = Parameters(
    (FREE, CONTACT, TRANSPORT, CYCLE, STROKES), priors=(1.0, 1.0, 0.03), cut=0.1, last=0.06
)
