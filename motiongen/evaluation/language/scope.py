"""Prompts that no rig can follow, or that are no motion at all: a generator is to warn of them."""

from __future__ import annotations

from itertools import product

_WORK = {
    "cook": ("dinner", "a pot of rice", "an omelette", "some pasta", "soup for six"),
    "drive": ("a car to work", "the bus", "a lorry", "a tractor", "home in the rain"),
    "play": ("the piano", "the violin", "chess with me", "poker", "a video game", "the drums", "tennis", "golf"),
    "write": ("a poem about rain", "a letter to my bank", "your name", "a shopping list", "some code"),
    "solve": ("a cubic equation", "a crossword", "the travelling salesman problem", "this riddle"),
    "clean": ("the windows", "the bathroom", "your glasses", "the kitchen floor"),
    "open": ("the door", "a bottle of wine", "a bank account", "your umbrella", "the spreadsheet"),
    "eat": ("a sandwich", "spaghetti", "an ice cream", "your breakfast"),
    "drink": ("a cup of tea", "some water", "a beer"),
    "fix": ("the bicycle", "my computer", "a leaking tap", "the roof"),
    "sew": ("a button on", "a dress", "the curtains"),
    "ride": ("a bicycle", "a horse", "a motorbike", "the escalator", "a wave on a surfboard"),
    "paint": ("the wall", "a portrait", "your nails"),
    "read": ("a newspaper", "the manual", "me a story"),
    "translate": ("this into French", "the menu"),
    "build": ("a sandcastle", "a house of cards", "a wooden chair"),
    "buy": ("a train ticket", "two kilos of potatoes", "some shares"),
    "swim": ("in the ocean", "twenty lengths", "under the bridge"),
    "climb": ("a ladder", "a tree", "Mount Everest", "over the fence"),
    "crawl": ("under a table", "through the tunnel", "like a baby"),
    "do": ("a backflip", "a cartwheel", "a handstand", "twenty push-ups", "your homework", "the dishes", "the splits"),
}
_NO_MOTION = (
    "quantum mechanics lecture", "the stock market crashed", "what is the capital of France", "a cat purrs",
    "asdfgh qwerty", "lorem ipsum dolor sit amet", "it rained all week", "my printer is out of paper",
    "how much is a kilo of apples", "the treaty was signed in 1648", "error 404", "blue", "seventeen divided by four",
    "tell me a joke", "who won the cup final", "the mitochondria is the powerhouse of the cell", "set an alarm for six",
    "photosynthesis", "my favourite colour is green", "what time does the museum close", "a bowl of tomato soup",
    "cheap flights to Lisbon", "the second movement is in C minor", "invoice number 20391", "why is the sky blue",
)  # fmt: skip
_FRAMES = ("{}", "please {}")

OUT_OF_SCOPE = (
    *(frame.format(f"{verb} {what}") for (verb, objects) in _WORK.items() for what, frame in product(objects, _FRAMES)),
    *_NO_MOTION,
    "sleep on a bed", "type on a keyboard", "brush your teeth", "fly an airplane", "parachute from a plane",
    "milk a cow", "juggle five balls", "shave your beard", "tie your shoelaces", "shoot an arrow", "row a boat",
    "change a light bulb", "take a selfie", "wrap a present", "peel an orange", "iron a shirt", "saw a plank",
)  # fmt: skip
