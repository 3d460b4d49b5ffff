# SPDX-License-Identifier: GPL-3.0-or-later
"""The cost of proving that files meet a tolerance: Suzanne is made adaptive, written in each format by the command
line, read back and measured: prints a table.

python benchmarks/certificates.py [TOLERANCE] [FORMAT…]    with the bpy wheel; CCDEPTH_FARM_BLENDER names a Blender

Suzanne is 2.7 m wide. Seconds are those of the whole command.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.farm.files import blender

FORMATS = ("stl", "obj", "ply", "glb", "usdc")


def main(tolerance: str, formats: list[str]) -> None:
    print(f"{'':<6}{'triangles':>10}{'MB':>7}{'seconds':>9}{'reached':>13}{'proved':>13}  met")
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        program = blender(folder)
        for suffix in formats:
            output, report = folder / f"suzanne.{suffix}", folder / f"{suffix}.json"
            line = ["--subdivide", "--tolerance", tolerance, "--output", str(output), "--json", str(report)]
            begun = perf_counter()
            subprocess.run([str(program), "-b", "--command", "ccdepth", *line], capture_output=True, check=False)
            seconds = perf_counter() - begun
            [each] = json.loads(report.read_text(encoding="utf-8"))["files"][0]["objects"]
            distances = each["measured"]
            print(
                f"{suffix:<6}{each['triangles']:>10,}{output.stat().st_size / 1e6:>7.1f}{seconds:>9.1f}"
                f"{1e3 * distances['reached']:>10.6f} mm{1e3 * distances['proved']:>10.6f} mm"
                f"  {'yes' if each['met'] else 'NO'}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "0.1mm", sys.argv[2:] or list(FORMATS))
