"""Names that help texts list: presets of the service, and scenarios of the simulated teacher.

A client install contains neither, so the names are listed here; a test compares them with the real ones.
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
