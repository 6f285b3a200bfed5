"""What one guided pass of the live network takes, by how it is run: for the choice of numpy in `motiongen/nn.py`."""

from __future__ import annotations

import logging
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from torch import nn

from motiongen.diffusion.configs import MdmConfig
from motiongen.diffusion.mdm import Mdm
from motiongen.diffusion.mdm_run import estimate, told
from motiongen.diffusion.said import texts, with_nothing
from motiongen.diffusion.weights import load_weights
from motiongen.nn import in_panels
from motiongen.text.encoder import TextEncoder

Run = Callable[[], np.ndarray]


def ways(weights: Path, quick: bool) -> dict[str, dict[str, float]]:
    """By way: milliseconds of processor time on one thread (median), and by what share its answer is off on average.
    `quick` leaves torch.compile out; ONNX Runtime is left out where it is not installed."""
    model = load_weights(weights)
    said = with_nothing(texts(TextEncoder(), ["walk forward"]))
    x = np.random.default_rng(0).standard_normal((2, model.window, len(model.mean)), np.float32)
    steering, frames = np.zeros((2, model.window, int(model.sizes["steering"])), np.float32), np.ones(x.shape[:2], bool)
    sizes = {name: int(model.sizes[name]) for name in ("patch", "heads")}
    same = told(model.tensors, sizes, frames, said, steering)
    panels = in_panels(model.tensors, 2 * (1 + model.window // sizes["patch"]))
    torch.set_num_threads(1)
    network = Mdm(MdmConfig(**model.sizes)).eval()
    network.load_state_dict({k: torch.from_numpy(v) for k, v in model.tensors.items()})
    said_so = (said.words, said.word_mask, said.sentence, said.keep)
    given = tuple(torch.from_numpy(np.asarray(y)) for y in (x, np.full(2, 0.5, np.float32), frames, *said_so))
    fed = (*given, None, torch.from_numpy(steering))

    def by_torch(run: Callable[..., torch.Tensor]) -> Run:
        return lambda: run(*fed).float().numpy()

    def in_bfloat16() -> np.ndarray:
        with torch.autocast("cpu", torch.bfloat16):
            return by_torch(network)()

    with torch.inference_mode(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what torch is about to drop or rename
        runs = {
            "numpy": lambda: estimate(model.tensors, sizes, x, 0.5, same),
            "numpy, matrices in panels": lambda: estimate(panels, sizes, x, 0.5, same),
            "torch eager": by_torch(network),
            "torch eager, bfloat16": in_bfloat16,
            "torch eager, int8": by_torch(torch.ao.quantization.quantize_dynamic(network, {nn.Linear})),
            "torch.export": by_torch(torch.export.export(network, fed).module()),
        }
        if not quick:
            runs["torch.compile"] = by_torch(torch.compile(network))
        if find_spec("onnxruntime") and find_spec("onnxscript"):
            runs |= _by_onnx(network, fed)
        wanted = runs["torch eager"]()
        return {
            name: {
                "ms": round(_median_ms(run, 10 if quick else 50), 2),
                "off": round(float(np.abs(run() - wanted).mean() / np.abs(wanted).mean()), 4),
            }
            for name, run in runs.items()
        }


def _by_onnx(network: nn.Module, fed: tuple[torch.Tensor | None, ...]) -> dict[str, Run]:
    import onnx
    import onnxruntime
    from onnxruntime.quantization import QuantType, quantize_dynamic

    logging.disable(logging.WARNING)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    sessions = {}
    with tempfile.TemporaryDirectory() as room:
        plain, small = Path(room) / "plain.onnx", Path(room) / "int8.onnx"
        torch.onnx.export(network, fed, plain, dynamo=True, external_data=False, verbose=False)
        graph = onnx.load(plain)
        del graph.graph.value_info[:]  # else the quantiser trips over shapes that it does not keep up to date
        onnx.save(graph, plain)
        quantize_dynamic(plain, small, weight_type=QuantType.QInt8)
        for name, path in (("ONNX Runtime", plain), ("ONNX Runtime, int8", small)):
            sessions[name] = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    arrays = [y.numpy() for y in fed if y is not None]

    def by(session: onnxruntime.InferenceSession) -> Run:
        feed = {given.name: array for given, array in zip(session.get_inputs(), arrays, strict=True)}
        return lambda: session.run(None, feed)[0]

    return {name: by(session) for name, session in sessions.items()}


def _median_ms(run: Run, repeats: int) -> float:
    run()
    took = []
    for _ in range(repeats):
        began = time.thread_time()
        run()
        took.append(time.thread_time() - began)
    return 1e3 * sorted(took)[len(took) // 2]
