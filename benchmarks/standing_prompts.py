"""What the benchmark of standing asks for: 100 prompts in five kinds, and the real clips beside them."""

from __future__ import annotations

SIDES = ("right", "left")

GESTURES = (
    *(f"wave with the {side} hand" for side in (*SIDES, "right", "left")),
    *(f"raise the {side} hand" for side in SIDES),
    *(f"raise the {side} arm sideways" for side in SIDES),
    *(f"point forward with the {side} hand" for side in SIDES),
    *(f"point up with the {side} hand" for side in SIDES),
    *(f"salute with the {side} hand" for side in SIDES),
    *(f"look to the {side}" for side in SIDES),
    *(f"beckon with the {side} hand" for side in SIDES),
    *(f"tilt the head to the {side}" for side in SIDES),
    *(f"twist to the {side}" for side in SIDES),
    *(f"lean to the {side}" for side in SIDES),
    *(f"put the {side} hand on the heart" for side in SIDES),
    "wave with both hands",
    "wave happily",
    "raise both hands",
    "raise both arms sideways",
    "bow",
    "bow politely",
    "bow slowly",
    "nod",
    "shake the head",
    "look around",
    "clap",
    "shrug",
    "put the hands on the hips",
    "cross the arms",
    "stretch",
    "celebrate",
    "stand in a T-pose",
    "flap the arms",
    "conduct",
    "open the arms in welcome",
    "lean forward",
    "sway",
    "stand idle",
    "squat",
)
STEPS = (
    "take a step forward",
    "take two steps forward",
    "take three steps forward",
    "take a step back",
    "take two steps back",
    *(f"sidestep to the {side}" for side in SIDES),
    "sidestep to the left three times",
    "march in place",
    "march in place slowly",
    "march in place with four steps",
    *(f"raise the {side} knee" for side in SIDES),
    *(f"balance on one leg with the {side} foot lifted" for side in SIDES),
)
WALKS = (
    "walk forward",
    "walk forward slowly",
    "walk forward happily",
    "walk forward wearily",
    "walk forward like an old person",
    "walk forward proudly",
    "walk backwards",
    "walk to the left",
    "walk to the right",
    "walk forward and wave with the right hand",
    "walk forward angrily",
    "walk forward like a child",
    "walk forward four steps",
    "walk forward, then stop",
    "walk",
)
TURNS = (
    *(f"turn to the {side}" for side in SIDES),
    *(f"turn {angle} degrees to the {side}" for angle in (45, 180) for side in SIDES),
    *(f"walk and turn {side}" for side in SIDES),
    "turn around",
    "turn 90 degrees to the left",
)
RUNS = (
    "run forward",
    "run forward happily",
    "run slowly",
    "jog",
    "run like a child",
    "run angrily",
    "dash forward",
    "run in a masculine way",
    "run and stop",
    "run wearily",
)
KINDS = {"gesture": GESTURES, "step": STEPS, "walk": WALKS, "turn": TURNS, "run": RUNS}

# Real clips, 100 in all: how many of a kind, and patterns of file names in Bandai-Namco's motion data set, in turn.
REAL = {"gesture": 40, "walk": 25, "turn": 20, "run": 15}
CLIPS = {
    "gesture": tuple(
        f"dataset-*_{content}_*.bvh"
        for content in (
            *("bow", "bye", "guide"),
            *("wave-right-hand", "raise-up-left-hand", "wave-both-hands", "raise-up-both-hands"),
        )
    ),
    "walk": tuple(f"dataset-*_{content}_*.bvh" for content in ("walk", "walk-back", "walk-left", "walk-right")),
    "turn": tuple(f"dataset-*_{content}_*.bvh" for content in ("walk-turn-left", "walk-turn-right")),
    "run": ("dataset-*_run_*.bvh", "dataset-1_dash_*.bvh"),
}
