"""What a training run is: a network and its sizes, what it predicts, how it learns."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import ClassVar, Literal


@dataclass(frozen=True)
class MdmConfig:
    """Sizes of MDM. `patch`: frames to a token; `text`: width of the text encoder's vectors; `actions`: how many are
    known; `history`: how many frames at the front are given instead of drawn; `steering`: numbers a frame that say
    where it should go, beside the text."""

    network: ClassVar[str] = "mdm"

    form: Literal["encoder", "decoder"] = "decoder"
    features: int = 140
    patch: int = 6
    width: int = 256
    layers: int = 4
    heads: int = 4
    feed_forward: int = 768
    text: int = 384
    dropout: float = 0.0
    actions: int = 0
    history: int = 0
    steering: int = 0


@dataclass(frozen=True)
class LiveConfig:
    """How a network learns to go on from a history for ever (see motiongen/live/objective.py).

    Attributes:
        chunk: Frames that it draws at once; at least as many as the history has.
        motions: How many are joined from the clips of the data set.
        rollouts: Share of the windows whose history it has drawn itself.
        truth: Steps before which all histories are true.
        no_history: Share of the windows that are shown without.
        steer_root: Share of the windows in which speed and turn are given.
        steer_hand: Share of the windows in which a hand's places are given; for each hand.
    """

    chunk: int = 48
    motions: int = 800
    rollouts: float = 0.25
    truth: int = 500
    no_history: float = 0.05
    steer_root: float = 0.35
    steer_hand: float = 0.1


@dataclass(frozen=True)
class MotionDiffuseConfig:
    """Sizes of MotionDiffuse. `patch`: frames to a token; `text`: width of the text encoder's vectors, `text_width` of
    what the network makes of them and of the condition e; `actions`: how many are known."""

    network: ClassVar[str] = "motiondiffuse"

    features: int = 140
    patch: int = 6
    width: int = 256
    layers: int = 4
    heads: int = 4
    feed_forward: int = 320
    text: int = 384
    text_width: int = 128
    text_layers: int = 2
    text_feed_forward: int = 192
    actions: int = 0


@dataclass(frozen=True)
class PhaseAutoencoderConfig:
    """Sizes of DiffusionPhase's auto-encoder. `highest`: frequency, in cycles a primary segment; `phases`: how many,
    over all frequencies; `cosine`: whether each gives a cosine beside its sine; `narrow`: channels after the encoder's
    convolution, `hidden` of its layers, `width` of the decoder; `kernel`: frames of a convolution; `noise`: deviation
    of what is added to the codes in training."""

    network: ClassVar[str] = "phase-autoencoder"
    patch: ClassVar[int] = 1

    features: int = 140
    highest: int = 30
    phases: int = 128
    cosine: bool = True
    narrow: int = 48
    hidden: int = 192
    width: int = 160
    kernel: int = 5
    noise: float = 0.1


@dataclass(frozen=True)
class DiffusionPhaseConfig:
    """Sizes of DiffusionPhase's denoiser of codes. `autoencoder`: folder of the finished run of its auto-encoder, whose
    sizes and scale it takes; `text`: width of the text encoder's vectors; `drop_pose`: share of the clips that are
    shown without a start pose; `codes`: how many stretches of clips are encoded to learn from; `decoded`: how
    many codes of a batch are also compared as the motions that they stand for."""

    network: ClassVar[str] = "diffusionphase"
    patch: ClassVar[int] = 1

    autoencoder: str = "runs/phase-autoencoder"
    features: int = 140
    width: int = 160
    layers: int = 4
    heads: int = 4
    feed_forward: int = 448
    text: int = 384
    drop_pose: float = 0.5
    codes: int = 80_000
    decoded: int = 16


Sizes = MdmConfig | MotionDiffuseConfig | PhaseAutoencoderConfig | DiffusionPhaseConfig


@dataclass(frozen=True)
class LossWeights:
    """Weights; a position error of 0.1 m, a speed error of 0.5 m/s and a foot speed of 0.5 m/s count as 1."""

    position: float = 0.5
    velocity: float = 0.25
    foot: float = 0.25


@dataclass(frozen=True)
class TrainConfig:
    """One run.

    Attributes:
        model: Sizes of the network.
        schedule: How the noise grows (see motiongen/diffusion/schedule.py).
        prediction: What the network tells: the clean motion (x0) or the noise in it.
        live: Learn to go on from a history; None: to draw whole clips.
        begin: Weights file, or the name of one in the tree, whose tensors a network of the same sizes begins with; what
            numbers mean is then taken from there.
        free: Learn only from clips whose licences allow commercial use (see motiongen/data/free.py).
        weights: Weights of the geometric losses, which need the prediction x0.
        steps: Steps in all.
        batch: Clips a step, over all processes.
        rate: Learning rate: warmed up, held, then linear to nothing.
        warm_up: Steps of the warm-up.
        decay: Share of the steps in which the rate falls at the end.
        weight_decay: Of AdamW and Muon.
        muon: Move matrices by Muon instead of AdamW: a step costs a fifth more and teaches more.
        balanced: Learn more where movements are settled, and weigh levels; see levels.py. For cosine and x0.
        clip: Norm to which gradients are clipped.
        ema: Decay of the average of the weights that is exported; it begins lower, so that the start is forgotten.
        drop_text: Share of the clips that are shown without text.
        by_action: Share of the clips whose text is an action's number, where one is known.
        bf16: Multiply in bfloat16; without it, where the processor or accelerator is made for that.
        compile: Compile the network first: minutes at the start, then faster steps.
        seed: What is drawn.
        save_every: Steps between checkpoints.
        log_every: Steps between lines of the log.
        show_every: Steps between films of what the network draws; 0 for none.
    """

    model: Sizes = field(default_factory=MdmConfig)
    schedule: Literal["cosine", "linear"] = "cosine"
    prediction: Literal["x0", "noise"] = "x0"
    live: LiveConfig | None = None
    begin: str = ""
    free: bool = False
    weights: LossWeights = field(default_factory=LossWeights)
    steps: int = 20_000
    batch: int = 48
    rate: float = 5e-4
    warm_up: int = 200
    decay: float = 0.25
    weight_decay: float = 0.01
    muon: bool = False
    balanced: bool = False
    clip: float = 1.0
    ema: float = 0.999
    drop_text: float = 0.1
    by_action: float = 0.1
    bf16: bool | None = None
    compile: bool = False
    seed: int = 0
    save_every: int = 200
    log_every: int = 50
    show_every: int = 2000


_RANGES = (
    *((name, 1, math.inf) for name in ("steps", "batch", "save_every", "log_every")),
    *((name, 0, math.inf) for name in ("warm_up", "show_every", "seed", "weight_decay")),
    *((name, 0, 1) for name in ("decay", "ema", "drop_text", "by_action")),
    *((name, 1e-9, math.inf) for name in ("rate", "clip")),
)
_OF_PHASES = {"prediction": "x0", "begin": "", "by_action": 0, "balanced": False, "show_every": 0, "compile": False}


def require_sound(config: TrainConfig) -> None:
    """Raises ValueError where a number of a config is out of range, or what it asks for does not go together."""
    for name, least, most in _RANGES:
        value = getattr(config, name)
        if not least <= value <= most:
            raise ValueError(f"{name} must be {_range(least, most)}, not {value}")
    if isinstance(config.model, PhaseAutoencoderConfig | DiffusionPhaseConfig):
        _require_phase(config)
    elif config.model.actions:
        raise ValueError(f"actions is told by the data set; leave it 0, not {config.model.actions}")
    if config.prediction == "noise" and any(asdict(config.weights).values()):
        raise ValueError("prediction noise has no geometric losses; set weights.position, velocity and foot to 0")
    _require_live(config)
    if config.balanced and (config.schedule, config.prediction) != ("cosine", "x0"):
        raise ValueError("balanced is for schedule cosine and prediction x0; leave it out")


def _require_phase(config: TrainConfig) -> None:
    for name, only in _OF_PHASES.items():
        if (value := getattr(config, name)) != only:
            raise ValueError(f"{name} must be {only} for {config.model.network}, not {value}")


def _require_live(config: TrainConfig) -> None:
    history = config.model.history if isinstance(config.model, MdmConfig) else 0
    if (config.live is None) != (history == 0):
        raise ValueError(f"live and model.history go together; there is a history of {history} frames")
    if config.live is None:
        return
    chunk, patch = config.live.chunk, config.model.patch
    if chunk < history or chunk % patch or history % patch:
        raise ValueError(f"live.chunk {chunk} and model.history {history}: multiples of {patch}, the chunk no shorter")
    if config.prediction != "x0" or config.schedule != "cosine" or config.by_action or config.show_every:
        raise ValueError("live is for prediction x0, schedule cosine, by_action 0 and show_every 0")
    for name in ("rollouts", "no_history", "steer_root", "steer_hand"):
        if not 0 <= (value := getattr(config.live, name)) <= 1:
            raise ValueError(f"live.{name} must be 0 to 1, not {value}")


def _range(least: float, most: float) -> str:
    return f"{least:g} or more" if most == math.inf else f"{least:g} to {most:g}"
