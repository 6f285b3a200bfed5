"""The words of a data set's contents and styles: what each is called, by verbs, nouns, adverbs and adjectives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Content:
    """How people name an action: third person ("waves …") and imperative ("wave …") verb phrases in step, and nouns."""

    third: tuple[str, ...]
    plain: tuple[str, ...]
    nouns: tuple[str, ...] = ()


def _hand(side: str) -> Content:
    """Who just says "wave" means the right hand."""
    return Content(
        third=(
            f"waves with the {side} hand", f"waves the {side} hand", f"is waving their {side} hand",
            f"waves hello with the {side} hand", f"lifts the {side} arm and waves",
            f"greets someone by waving the {side} hand", f"waves using the {side} arm",
            *(("waves", "waves hello", "says hello", "waves at someone", "waves hi",
            "says hi") if side == "right" else ()),
        ),
        plain=(
            f"wave with the {side} hand", f"wave the {side} hand", f"wave your {side} hand",
            f"wave hello with the {side} hand", f"lift the {side} arm and wave",
            f"greet me by waving your {side} hand", f"wave using the {side} arm",
            *(("wave", "wave hello", "say hello", "wave at me", "wave hi", "say hi") if side == "right" else ()),
        ),
        nouns=(
            f"a wave with the {side} hand", f"{side} hand waving", f"{side} hand wave",
            *(("a wave", "a friendly wave") if side == "right" else ()),
        ),
    )  # fmt: skip


def _raise(side: str) -> Content:
    return Content(
        third=(
            f"raises the {side} hand", f"lifts up the {side} hand", f"puts the {side} hand up",
            f"raises the {side} arm in the air", f"is raising their {side} hand once",
            f"holds up the {side} hand", f"raises the {side} hand like a pupil in class",
            *(("raises a hand", "puts one hand up") if side == "right" else ()),
        ),
        plain=(
            f"raise the {side} hand", f"lift up the {side} hand", f"put your {side} hand up",
            f"raise the {side} arm in the air", f"raise your {side} hand once",
            f"hold up the {side} hand", f"raise the {side} hand like a pupil in class",
            *(("raise a hand", "put one hand up") if side == "right" else ()),
        ),
        nouns=(f"{side} hand up", f"a raised {side} hand"),
    )  # fmt: skip


def _sidestep(side: str) -> Content:
    return Content(
        third=(
            f"walks sideways to the {side}", f"sidesteps to the {side}", f"steps sideways to the {side}",
            f"walks to the {side} without turning", f"moves sideways to the {side}", f"shuffles to the {side}",
        ),
        plain=(
            f"walk sideways to the {side}", f"sidestep to the {side}", f"step sideways to the {side}",
            f"walk to the {side} without turning", f"move sideways to the {side}", f"shuffle to the {side}",
        ),
        nouns=(f"a sidestep to the {side}", f"sidestepping {side}"),
    )  # fmt: skip


def _turn(side: str) -> Content:
    return Content(
        third=(
            f"walks and turns {side}", f"walks forward and turns to the {side}", f"turns {side} while walking",
            f"walks around a corner to the {side}", f"takes a {side} turn", f"walks then turns to the {side}",
            f"walks in a curve to the {side}",
        ),
        plain=(
            f"walk and turn {side}", f"walk forward and turn to the {side}", f"turn {side} while walking",
            f"walk around a corner to the {side}", f"take a {side} turn", f"walk then turn to the {side}",
            f"walk in a curve to the {side}",
        ),
        nouns=(f"a walk with a {side} turn", f"a {side} turn", f"turning {side}"),
    )  # fmt: skip


CONTENTS: dict[str, Content] = {
    "walk": Content(
        ("walks", "walks forward", "is walking", "walks straight ahead", "strolls along", "takes a walk",
         "steps forward", "goes for a walk", "takes some steps", "walks on"),
        ("walk", "walk forward", "keep walking", "walk straight ahead", "stroll along", "take a walk",
         "step forward", "go for a walk", "take some steps", "walk on"),
        ("walking", "a walk", "walking forward"),
    ),
    "run": Content(
        ("runs", "runs forward", "is running", "jogs", "goes jogging", "jogs forward", "runs along"),
        ("run", "run forward", "keep running", "jog", "go jogging", "jog forward", "run along"),
        ("running", "a run", "jogging"),
    ),
    "dash": Content(
        ("dashes", "sprints", "dashes forward", "sprints forward", "runs at full speed", "rushes ahead", "bolts",
         "makes a dash for it"),
        ("dash", "sprint", "dash forward", "sprint forward", "run at full speed", "rush ahead", "bolt",
         "make a dash for it"),
        ("a dash", "sprinting", "a sprint"),
    ),
    "walk-back": Content(
        ("walks backwards", "steps back", "walks back", "backs away", "retreats", "moves backwards",
         "walks in reverse"),
        ("walk backwards", "step back", "walk back", "back away", "retreat", "move backwards", "walk in reverse"),
        ("walking backwards", "a backward walk", "a step back"),
    ),
    "walk-left": _sidestep("left"),
    "walk-right": _sidestep("right"),
    "walk-turn-left": _turn("left"),
    "walk-turn-right": _turn("right"),
    "wave-left-hand": _hand("left"),
    "wave-right-hand": _hand("right"),
    "wave-both-hands": Content(
        ("waves both hands", "waves with both hands", "is waving both arms", "waves both hands in the air",
         "greets someone by waving both hands", "lifts both arms and waves"),
        ("wave both hands", "wave with both hands", "wave both your arms", "wave both hands in the air",
         "greet me by waving both hands", "lift both arms and wave"),
        ("waving with both hands", "a two-handed wave", "both hands waving"),
    ),
    "raise-up-left-hand": _raise("left"),
    "raise-up-right-hand": _raise("right"),
    "raise-up-both-hands": Content(
        ("raises both hands", "lifts up both hands", "puts both hands up", "raises both arms in the air",
         "throws both hands up", "holds up both hands", "raises the arms overhead"),
        ("raise both hands", "lift up both hands", "put both your hands up", "raise both arms in the air",
         "throw both hands up", "hold up both hands", "raise the arms overhead"),
        ("both hands up", "hands up", "arms up"),
    ),
    "bow": Content(
        ("bows", "takes a bow", "bows down", "bows politely at the waist", "bends forward in a bow",
         "makes a deep bow", "bows to greet", "does a bow", "gives a bow"),
        ("bow", "take a bow", "bow down", "bow politely at the waist", "bend forward in a bow", "make a deep bow",
         "bow to greet", "do a bow", "give a bow"),
        ("a bow", "bowing", "a polite bow"),
    ),
    "bye": Content(
        ("says goodbye", "says farewell", "waves goodbye", "says goodbye and leaves", "bids farewell",
         "gestures goodbye", "says bye", "waves bye"),
        ("say goodbye", "say farewell", "wave goodbye", "say goodbye and leave", "bid farewell", "gesture goodbye",
         "say bye", "wave bye"),
        ("a goodbye", "a farewell", "goodbye", "a farewell wave"),
    ),
    "byebye": Content(
        ("says bye-bye", "waves bye-bye", "waves bye bye to a friend", "says bye bye", "does a bye-bye wave",
         "waves byebye", "says byebye", "waves bye bye"),
        ("say bye-bye", "wave bye-bye", "wave bye bye to a friend", "say bye bye", "do a bye-bye wave",
         "wave byebye", "say byebye", "wave bye bye"),
        ("bye-bye", "a bye-bye wave", "bye bye", "byebye", "a bye bye wave"),
    ),
    "guide": Content(
        ("guides someone", "shows the way", "gestures this way please", "leads a guest along",
         "points out the way with an open hand", "guides a visitor", "invites someone to come along"),
        ("guide someone", "show the way", "gesture this way please", "lead a guest along",
         "point out the way with an open hand", "guide a visitor", "invite someone to come along"),
        ("guiding", "a guiding gesture", "showing the way"),
    ),
    "call": Content(
        ("calls someone over", "calls out to someone", "beckons", "calls a friend with a gesture",
         "waves someone over", "summons someone", "signals to come over"),
        ("call someone over", "call out to someone", "beckon", "call a friend with a gesture", "wave someone over",
         "summon someone", "signal to come over"),
        ("a come-here gesture", "calling someone over"),
    ),
    "respond": Content(
        ("responds to a call", "answers someone's call", "reacts to someone", "answers a call",
         "replies to someone", "acknowledges someone"),
        ("respond to a call", "answer someone's call", "react to someone", "answer a call", "reply to someone",
         "acknowledge someone"),
        ("a response to a call", "an answer"),
    ),
    "kick": Content(
        ("kicks", "throws a kick", "kicks with the leg", "does a fighting kick", "does a kick", "kicks the air"),
        ("kick", "throw a kick", "kick with the leg", "do a fighting kick", "do a kick", "kick the air"),
        ("a kick", "kicking"),
    ),
    "punch": Content(
        ("punches", "throws a punch", "boxes", "hits with the fist", "punches the air", "does some boxing"),
        ("punch", "throw a punch", "box", "hit with the fist", "punch the air", "do some boxing"),
        ("a punch", "punching"),
    ),
    "slash": Content(
        ("slashes with a sword", "swings a sword", "makes a slashing attack", "cuts the air with a sword",
         "fights with a sword"),
        ("slash with a sword", "swing a sword", "make a slashing attack", "cut the air with a sword",
         "fight with a sword"),
        ("a sword slash", "slashing", "a sword swing"),
    ),
    "dance-short": Content(
        ("dances", "is dancing", "does a dance", "dances to music", "grooves", "busts a move", "does a little dance"),
        ("dance", "keep dancing", "do a dance", "dance to music", "groove", "bust a move", "do a little dance"),
        ("a dance", "dancing", "a little dance"),
    ),
}  # fmt: skip

# Style → (adverbs, adjectives for "a … person"). An empty string is "say nothing of it".
STYLES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "normal": (("", "", "normally", "at a normal pace"), ("", "")),
    "active": (("actively", "energetically", "with energy", "briskly"), ("energetic", "active", "lively")),
    "elderly": (("like an old person", "slowly with age"), ("old", "elderly", "frail old")),
    "exhausted": (("exhaustedly", "wearily", "as if exhausted"), ("exhausted", "tired", "worn-out")),
    "feminine": (("in a feminine way", "gracefully"), ("feminine",)),
    "masculine": (("in a masculine way", "like a tough man"), ("masculine", "manly")),
    "youthful": (("youthfully", "like a young person"), ("young", "youthful")),
    "angry": (("angrily", "in anger"), ("angry", "furious")),
    "childish": (("childishly", "like a child"), ("childish", "childlike")),
    "chimpira": (("like a thug", "with a swagger"), ("thuggish", "cocky")),
    "giant": (("like a giant", "heavily"), ("giant", "huge")),
    "happy": (("happily", "cheerfully", "joyfully"), ("happy", "cheerful")),
    "musical": (("as in a musical", "theatrically"), ("theatrical",)),
    "not-confident": (("timidly", "without confidence", "shyly"), ("timid", "shy", "insecure")),
    "proud": (("proudly", "with pride"), ("proud", "confident")),
    "sad": (("sadly", "in a sad way"), ("sad", "unhappy")),
}
_SAME_STYLE = {"masculinity": "masculine", "old": "elderly", "tired": "exhausted"}
