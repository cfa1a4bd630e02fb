"""Ratios measured side by side, printed, and written as CSV and picture.

python tests/benchmarks/run.py [--quick] [--out results/benchmarks] [--page]
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import shutil
import sys
from datetime import date
from importlib.metadata import version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import cases
from measure import Row

from vemcvx.base.table import Table

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="n = 64 in place of 256, and no million unknowns")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--page", action="store_true", help="put the table and the picture into the page of benchmarks")
    arguments = parser.parse_args()
    n = 64 if arguments.quick else 256
    rows = [
        *cases.paper(n),
        *cases.space(12 if arguments.quick else 24),
        *cases.assembly(n),
        *cases.imports(),
    ]
    sizes = [32, 64, 128] if arguments.quick else [128, 181, 256, 362, 512, 707]
    growths = {name: cases.growth(sizes, name) for name in cases.LINEAR}
    rows += [cases.growth_row(growth, name) for name, growth in growths.items()]
    arguments.out.mkdir(parents=True, exist_ok=True)
    write(rows, arguments.out / "ratios.csv")
    with open(arguments.out / "growth.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=["linear", *growths["SuperLU"][0]])
        writer.writeheader()
        writer.writerows({"linear": name, **one} for name, growth in growths.items() for one in growth)
    cases.picture(rows, growths, arguments.out / "benchmarks.png")
    show(rows, arguments.out)
    if arguments.page:
        into_page(rows, arguments.out / "benchmarks.png")


COLUMNS = ("what", "seconds", "CPU", "against", "its seconds", "its CPU", "ratio", "ratio of CPU", "wanted")


def cells(row: Row) -> list[str]:
    """A row of the table, in the order of COLUMNS."""

    def shown(number: float | None) -> str:
        return "" if number is None else f"{number:.3g}"

    numbers = (row.reference_seconds, row.reference_cpu, row.ratio, row.cpu_ratio)
    return [row.name, shown(row.seconds), shown(row.cpu), row.reference, *map(shown, numbers), row.wanted]


def write(rows: list[Row], path: Path) -> None:
    path.write_text(Table(COLUMNS, [cells(row) for row in rows]).csv())


def conditions() -> str:
    """When, where and with what it was measured, in a sentence."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("vemcvx", "numpy", "scipy", "clarabel", "cvxpy"))
    models = [line.partition(":")[2].strip() for line in cpu_info() if line.startswith("model name")]
    processor = f"{os.cpu_count()} cores of {models[0] if models else platform.processor() or platform.machine()}"
    return f"Measured on {date.today():%d %B %Y}, on {processor}, with Python {platform.python_version()}, {packages}."


def cpu_info() -> list[str]:
    """What Linux says of the processor, line by line; nothing elsewhere."""
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def into_page(rows: list[Row], picture: Path) -> None:
    """Replace what stands between the marks of the page of benchmarks by what was just measured."""
    root = Path(__file__).parents[2]
    page = root / "docs" / "benchmarks.md"
    before, rest = page.read_text().split(BEGIN)
    after = rest.split(END)[1]
    table = Table(COLUMNS, [cells(row) for row in rows]).markdown()
    page.write_text(f"{before}{BEGIN}\n{table}\n{conditions()}\n{END}{after}")
    shutil.copy(picture, root / "problems" / "pictures" / "benchmarks.png")


def show(rows: list[Row], folder: Path) -> None:
    print(f"measured side by side\n{Table(COLUMNS, [cells(row) for row in rows]).text()}\nwritten to {folder}")


if __name__ == "__main__":
    main()
