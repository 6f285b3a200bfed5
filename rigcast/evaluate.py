"""`rigcast eval`: measure generators, baselines, real clips or anybody's motion files; `rigcast eval compare`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from rigcast import show

if TYPE_CHECKING:
    from motiongen.evaluation.run.sets import Sets
    from motiongen.motion import Motion


def evaluate(
    subjects: Positional[tuple[str, ...]],
    /,
    *,
    data: Path,
    out: Path,
    evaluators: Path | None = None,
    rig: str | None = None,
    candidates: int = 1,
    seed: int = 0,
    quick: bool = False,
    json: bool = False,
) -> int:
    """Measure what SUBJECTS make of held-out captions and of the language tests; results.json and report.html in OUT.

    Args:
        subjects: A generator (see `rigcast generators`), a .safetensors file of weights, retrieval, mean-pose, noise,
            real (held-out clips), or a folder of motion files with captions.csv, any number of them.
        data: Folder of a data set (`rigcast data build`).
        out: Folder for the results; drawn motions are kept there, and the same command goes on from them.
        evaluators: Folder of the evaluators, trained there where missing; by default OUT/evaluators.
        rig: Rig on which some of the motions are put through physics, too.
        candidates: Motions drawn for a prompt, of which the one is kept that measures right.
        seed: What is asked for and drawn.
        quick: Few prompts and short training: two minutes on two cores, and wide intervals.
        json: Print results.json instead of a table.
    """
    from motiongen.data.dataset import open_dataset
    from motiongen.evaluation.report.page import write_report
    from motiongen.evaluation.run.evaluate import evaluate as run
    from motiongen.evaluation.run.results import write_results
    from motiongen.evaluation.run.sets import FULL, QUICK
    from motiongen.evaluation.run.show import Wish

    if not subjects:
        raise ValueError("nothing to evaluate; name a subject, for example mdm or real")
    dataset = open_dataset(data)
    out.mkdir(parents=True, exist_ok=True)
    wish = Wish(QUICK if quick else FULL, evaluators or out / "evaluators", out / "motions", seed, candidates)
    with _progress() as tell:
        results, sets, examples = run(subjects, dataset, wish, tell, None if rig is None else _gate(rig, tell))
    write_results(results, out / "results.json")
    write_report(results, examples, out / "report.html")
    _write_prompts(sets, out / "prompts.csv")
    if json:
        print((out / "results.json").read_text(encoding="utf-8"), end="")
    else:
        _print_table(out / "results.json")
        print(f"wrote {out / 'results.json'}, {out / 'report.html'} and {out / 'prompts.csv'}")
    return 0


def compare(a: Positional[Path], b: Positional[Path], /, *, json: bool = False) -> int:
    """Say where B differs from A, prompt by prompt, and whether chance alone would do as much.

    Args:
        a: A results.json, or the folder with it, or either with #SUBJECT where it holds several.
        b: Another, of the same data set, plan and seed.
        json: Print one JSON document instead of a table.
    """
    from dataclasses import asdict

    from motiongen.evaluation.compare import compare_files

    found = compare_files(str(a), str(b))
    if json:
        show.print_json(asdict(found))
        return 0
    table = show.new_table("measure", "prompts", found.a, found.b, "difference", "95 % interval", "p", "")
    for column in range(1, 7):
        table.columns[column].justify = "right"
    for row in found.rows:
        table.add_row(
            f"{row.group}: {row.name}", str(row.n), f"{row.a:.3g}", f"{row.b:.3g}", f"{row.difference:+.3g}",
            f"{row.low:+.3g} … {row.high:+.3g}", f"{row.p:.2g}", row.verdict,
        )  # fmt: skip
    show.console().print(table)
    print(found.sentence)
    return 0


def _gate(rig: str, tell: Callable[[str, int, int], None]) -> Callable[[Sequence[Motion]], tuple[str, int]]:
    from retarget.rig import load_rig

    load_rig(rig)  # a wrong name is told before any work

    def gate(motions: Sequence[Motion]) -> tuple[str, int]:
        from rigcast.pass_rate import pass_rate

        found = pass_rate(motions, rig, progress=lambda done, total: tell(f"physics on {rig}", done, total))
        return f"{found.rig}, {found.mount}", found.passed

    return gate


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr that says what is done; each new thing takes the place of the one before."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task, said = bar.add_task("opening", total=None), "opening"

        def tell(what: str, done: int, total: int) -> None:
            nonlocal task, said
            if what != said:
                bar.remove_task(task)
                task, said = bar.add_task(what, total=total or None), what
            bar.update(task, completed=done)

        yield tell


def _print_table(path: Path) -> None:
    from rich.markup import escape

    from motiongen.evaluation.report.table import headings, table_rows
    from motiongen.evaluation.run.results import read_results

    results = read_results(path)
    table = show.new_table(*headings(results), title=f"{results.data}, {results.date}, {results.machine}")
    for column in table.columns[1:]:
        column.justify = "right"
    for row in table_rows(results):
        table.add_row(*map(escape, row.cells), style="bold" if row.heading else None)
    show.console().print(table)


def _write_prompts(sets: Sets, path: Path) -> None:
    """What was asked for, so that others' generators can be asked the same."""
    from motiongen.files import replacing

    rows: list[tuple[str, object]] = [*zip(sets.clips.captions, sets.seconds, strict=True)]
    rows += [(text, "") for text, _ in sets.contents] + [(prompt.text, "") for prompt in sets.language]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("caption", "seconds"))
        writer.writerows(rows)
