"""Runs every benchmark of this folder, one after the other: python -m benchmarks [NAME ...]"""

import runpy
import sys
from pathlib import Path


def main() -> None:
    names = sorted(path.stem for path in Path(__file__).parent.glob("bench_*.py"))
    chosen = sys.argv[1:]
    known = [name.removeprefix("bench_") for name in names]
    if strange := [name for name in chosen if name not in known]:
        sys.exit(
            f"{' '.join(strange)}: expected names among {', '.join(known)}; options go to a benchmark itself."
        )
    for name in names:
        if not chosen or name.removeprefix("bench_") in chosen:
            print(f"\n== {name}", flush=True)
            sys.argv = [name]  # what was chosen here is no argument of theirs
            runpy.run_module(f"benchmarks.{name}", run_name="__main__")


if __name__ == "__main__":
    main()
