"""Names that help texts list: presets of the service, and scenarios of the simulated teacher.

A client install has neither, so they are written here; a test compares them with what there is.
"""

PRESET_NAMES = (
    "default",
    "strokes",
    "constant_velocity",
    "second_order_1",
    "second_order_2",
    "force",
    "contact",
    "integrated",
    "integrated_tab_4_5",
)
SCENARIO_NAMES = (
    "three_point",
    "parkour",
    "pick_and_place",
    "dispenser",
    "wiping",
    "button",
    "tracing",
    "curves",
    "screwing",
    "peg",
    "pouring",
    "circle",
    "contour",
    "peeling",
)
