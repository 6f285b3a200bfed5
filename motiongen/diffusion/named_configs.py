"""The configs that have a name: small ones, as in the tree, and those of the papers."""

from __future__ import annotations

from dataclasses import replace

from motiongen.diffusion.configs import (
    DiffusionPhaseConfig,
    LiveConfig,
    LossWeights,
    MdmConfig,
    MotionDiffuseConfig,
    PhaseAutoencoderConfig,
    TrainConfig,
)

_SMALL = TrainConfig(muon=True, balanced=True)
_MDM_SIZES = MdmConfig("encoder", patch=1, width=512, layers=8, heads=4, feed_forward=1024, dropout=0.1)
_MDM_PAPER = TrainConfig(
    _MDM_SIZES,
    steps=600_000,
    batch=64,
    rate=1e-4,
    decay=0.0,
    weight_decay=0.0,
    ema=0.9999,
    save_every=1000,
    show_every=20_000,
)
_NOISE = TrainConfig(
    MotionDiffuseConfig(), schedule="linear", prediction="noise", weights=LossWeights(0.0, 0.0, 0.0), muon=True
)
_PHASE = TrainConfig(PhaseAutoencoderConfig(), steps=3000, rate=1e-3, by_action=0.0, muon=True, show_every=0)
CONFIGS: dict[str, TrainConfig] = {
    "mdm": _SMALL,
    "free": replace(_SMALL, free=True),
    "motiondiffuse": _NOISE,
    "phase-autoencoder": _PHASE,
    "diffusionphase": replace(_PHASE, model=DiffusionPhaseConfig(), steps=3200, batch=128, rate=7e-4),
    "live": TrainConfig(
        MdmConfig(history=30, steering=12),
        live=LiveConfig(),
        begin="mdm",
        steps=9000,
        batch=96,
        by_action=0.0,
        muon=True,
        balanced=True,
        show_every=0,
    ),
    "mdm-paper": _MDM_PAPER,
    "mdm-decoder-paper": replace(_MDM_PAPER, model=replace(_MDM_SIZES, form="decoder")),
    "motiondiffuse-paper": replace(
        _NOISE,
        model=MotionDiffuseConfig(
            patch=1,
            width=512,
            layers=8,
            heads=8,
            feed_forward=1024,
            text_width=256,
            text_layers=4,
            text_feed_forward=1024,
        ),
        steps=100_000,
        batch=1024,
        rate=2e-4,
        decay=0.0,
        weight_decay=0.0,
        muon=False,
        drop_text=0.0,
        save_every=1000,
        show_every=10_000,
    ),
}
"""Small ones, as in the tree; and the sizes, rates and batches of the papers (Tevet et al. 2022, Sec. 4; Zhang et al.
2022, Sec. 4.2), which say nothing of clipping, warm-up and, MotionDiffuse's, of an average."""


def named(name: str) -> TrainConfig:
    """The config of a name; raises ValueError for one that is not known."""
    if name not in CONFIGS:
        raise ValueError(f"no generator {name!r} to train; there are {', '.join(CONFIGS)}")
    return CONFIGS[name]
