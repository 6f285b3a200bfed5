"""Processes that train together, as `torchrun` starts them: each takes its share of every batch; gradients add up."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

_PATIENCE = timedelta(hours=2)  # the others wait while the first encodes captions


@dataclass(frozen=True)
class Team:
    """This process: number `rank` of `size`, computing on `device`. Number 0 alone writes files and talks."""

    rank: int
    size: int
    device: torch.device

    @property
    def first(self) -> bool:
        return self.rank == 0

    @property
    def share(self) -> slice:
        """Which clips of a batch are this process's."""
        return slice(self.rank, None, self.size)

    def wait(self) -> None:
        """Until all processes are here."""
        if self.size > 1:
            dist.barrier()

    def add_up(self, tensors: Sequence[Tensor]) -> None:
        """Put the sum over all processes into each of `tensors`, in one message."""
        if self.size > 1:
            flat = parameters_to_vector(tensors)
            dist.all_reduce(flat)
            vector_to_parameters(flat, tensors)


@contextmanager
def join() -> Iterator[Team]:
    """This process among those that `torchrun` started, or alone; on an accelerator where torch finds one."""
    size, local = int(os.environ.get("WORLD_SIZE", "1")), int(os.environ.get("LOCAL_RANK", "0"))
    cuda = torch.cuda.is_available()
    device = torch.device("cuda", local) if cuda else torch.device("cpu")
    if cuda:
        torch.cuda.set_device(device)
    if size == 1:
        yield Team(0, 1, device)
        return
    dist.init_process_group("nccl" if cuda else "gloo", timeout=_PATIENCE)
    try:
        yield Team(dist.get_rank(), size, device)
    finally:
        dist.destroy_process_group()
