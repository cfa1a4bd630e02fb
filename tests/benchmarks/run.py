"""Ratios measured side by side, printed, and written as CSV and picture.

python tests/benchmarks/run.py [--quick] [--out results/benchmarks] [--readme]
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import cases
from measure import Row
from rich.console import Console
from rich.table import Table

# Memory that a process touches for the first time can cost as much as the work done in it (half a second a
# quarter of a GB on the machine this was written on). With these settings of glibc freed memory stays with the
# process, for the reference and for us alike; the first, uncounted round pays for it.
KEEP_MEMORY = {
    "MALLOC_MMAP_THRESHOLD_": "4000000000",
    "MALLOC_TRIM_THRESHOLD_": "8000000000",
    "MALLOC_TOP_PAD_": "268435456",
}
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="n = 64 in place of 256, and no million unknowns")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--readme", action="store_true", help="put the table and the picture into the README")
    arguments = parser.parse_args()
    if not KEEP_MEMORY.items() <= os.environ.items():
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **KEEP_MEMORY})
    n = 64 if arguments.quick else 256
    rows = [*cases.paper(n), *cases.assembly(n), *cases.imports()]
    growth = cases.growth([32, 64, 128] if arguments.quick else [128, 181, 256, 362, 512, 707])
    rows.append(cases.growth_row(growth))
    arguments.out.mkdir(parents=True, exist_ok=True)
    write(rows, arguments.out / "ratios.csv")
    with open(arguments.out / "growth.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(growth[0]))
        writer.writeheader()
        writer.writerows(growth)
    cases.picture(rows, growth, arguments.out / "benchmarks.png")
    show(rows, arguments.out)
    if arguments.readme:
        into_readme(rows, arguments.out / "benchmarks.png")


def write(rows: list[Row], path: Path) -> None:
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["what", "seconds", "against", "its seconds", "ratio", "wanted"])
        for row in rows:
            writer.writerow([row.name, row.seconds, row.reference, row.reference_seconds, row.ratio, row.wanted])


def into_readme(rows: list[Row], picture: Path) -> None:
    """Replace what stands between the marks in the README by what was just measured."""
    root = Path(__file__).parents[2]
    readme = root / "README.md"
    lines = ["| what | seconds | against | its seconds | ratio | wanted |", "|---|---|---|---|---|---|"]
    for row in rows:
        numbers = f"{row.seconds:.3g} | {row.reference} | {row.reference_seconds:.3g} | **{row.ratio:.3g}**"
        lines.append(f"| {row.name} | {numbers} | {row.wanted} |")
    before, rest = readme.read_text().split(BEGIN)
    after = rest.split(END)[1]
    readme.write_text(before + BEGIN + "\n" + "\n".join(lines) + "\n" + END + after)
    shutil.copy(picture, root / "problems" / "pictures" / "benchmarks.png")


def show(rows: list[Row], folder: Path) -> None:
    table = Table("what", "seconds", "against", "its seconds", "ratio", "wanted", title="measured side by side")
    for row in rows:
        numbers = f"{row.seconds:.3g}", row.reference, f"{row.reference_seconds:.3g}", f"{row.ratio:.3g}"
        table.add_row(row.name, *numbers, row.wanted)
    console = Console()
    console.print(table)
    console.print(f"written to {folder}")


if __name__ == "__main__":
    main()
