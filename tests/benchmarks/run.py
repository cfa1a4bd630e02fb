"""Measure times and reference times, print ratios, and write a CSV file and a picture.

python tests/benchmarks/run.py [--quick] [--out results/benchmarks] [--page]
"""

from __future__ import annotations

import argparse
import csv
import os
import platform
import re
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
    parser.add_argument("--quick", action="store_true", help="use smaller meshes and fewer steps")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--page", action="store_true", help="write the table and the picture to the page of benchmarks")
    arguments = parser.parse_args()
    n = 64 if arguments.quick else 256
    rows = [
        *cases.measure_paper(n),
        *cases.measure_space(12 if arguments.quick else 24),
        *cases.measure_assembly(n),
    ]
    sizes = [32, 64, 128] if arguments.quick else [128, 181, 256, 362, 512, 707]
    growths = {name: cases.measure_growth(sizes, name) for name in cases.LINEAR}
    rows += [cases.growth_row(growth, name) for name, growth in growths.items()]
    arguments.out.mkdir(parents=True, exist_ok=True)
    table = Table(COLUMNS, [cells(row) for row in rows])
    (arguments.out / "ratios.csv").write_text(table.csv())
    with open(arguments.out / "growth.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=["linear", *growths["SuperLU"][0]])
        writer.writeheader()
        writer.writerows({"linear": name, **one} for name, growth in growths.items() for one in growth)
    cases.draw_picture(growths, arguments.out / "benchmarks.png")
    print(f"measured side by side\n{table.text()}\nwritten to {arguments.out}")
    if arguments.page:
        write_page(table, arguments.out / "benchmarks.png")


REFERENCE = ("reference", "reference, seconds", "reference, CPU seconds")
COLUMNS = ("what", "seconds", "CPU seconds", *REFERENCE, "ratio", "ratio of CPU seconds", "wanted")


def cells(row: Row) -> list[str]:
    """Return a row of the table, in the order of COLUMNS."""

    def write(number: float | None) -> str:
        return "" if number is None else f"{number:.3g}"

    numbers = (row.reference_seconds, row.reference_cpu, row.ratio, row.cpu_ratio)
    return [row.name, write(row.seconds), write(row.cpu), row.reference, *map(write, numbers), row.wanted]


def conditions() -> str:
    """Return date, machine and versions in a sentence."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("vemcvx", "numpy", "scipy", "clarabel", "cvxpy"))
    info = Path("/proc/cpuinfo")  # Linux only
    models = re.findall(r"^model name\s*: (.*)$", info.read_text() if info.exists() else "", re.MULTILINE)
    processor = f"{os.cpu_count()} cores of {models[0] if models else platform.processor() or platform.machine()}"
    return f"Measured on {date.today():%d %B %Y}, on {processor}, with Python {platform.python_version()}, {packages}."


def write_page(table: Table, picture: Path) -> None:
    """Replace the table and the picture of the page docs/benchmarks.md."""
    root = Path(__file__).parents[2]
    page = root / "docs" / "benchmarks.md"
    before, rest = page.read_text().split(BEGIN)
    after = rest.split(END)[1]
    page.write_text(f"{before}{BEGIN}\n{table.markdown()}\n{conditions()}\n{END}{after}")
    shutil.copy(picture, root / "problems" / "pictures" / "benchmarks.png")


if __name__ == "__main__":
    main()
