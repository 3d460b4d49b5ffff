# SPDX-License-Identifier: GPL-3.0-or-later
"""Take the manual's pictures of Blender's real window, on a display without a screen.

python scripts/manual_pictures.py BLENDER EXTENSION    a Blender to start, and the built zip

Needs Xvfb and ImageMagick (import, mogrify).
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from virtual_display import virtual_display

CHECKOUT = Path(__file__).resolve().parent.parent
PICTURES = CHECKOUT / "ccdepth_addon" / "manual"
SCENES = Path(__file__).with_name("manual_scenes.py")
WIDTH, HEIGHT = 1440, 900

# The 3D View with its sidebar, at Blender's default layout.
VIEWPORT = "950x725+200+85"
SECONDS = 300.0


def take_pictures(folder: Path, screen: str) -> None:
    """Take a picture of each scene once Blender reports it ready. Raises TimeoutError."""
    until = time.monotonic() + SECONDS
    while not (folder / "end.ready").exists():
        if time.monotonic() > until:
            raise TimeoutError("Blender has not shown all scenes")
        for ready in folder.glob("*.ready"):
            picture = PICTURES / f"{ready.stem}.png"
            environment = {**os.environ, "DISPLAY": screen}
            subprocess.run(["import", "-window", "root", "-crop", VIEWPORT, str(picture)], env=environment, check=True)
            smaller = ["+repage", "-strip", "-dither", "None", "-colors", "256"]
            subprocess.run(["mogrify", *smaller, str(picture)], check=True)
            ready.unlink()
        time.sleep(0.2)


def main() -> int:
    blender, extension = sys.argv[1:]
    PICTURES.mkdir(exist_ok=True)
    with TemporaryDirectory() as name, virtual_display(WIDTH, HEIGHT) as screen:
        folder = Path(name)
        environment = {
            **os.environ,
            "BLENDER_USER_RESOURCES": str(folder / "resources"),
            "CCDEPTH_PICTURES": name,
            "DISPLAY": screen,
            "LIBGL_ALWAYS_SOFTWARE": "1",
        }
        install = [blender, "--command", "extension", "install-file", "-e", "-r", "user_default", extension]
        subprocess.run(install, env=environment, check=True)
        window = ["-p", "0", "0", str(WIDTH), str(HEIGHT)]
        process = subprocess.Popen([blender, *window, "--python", str(SCENES)], env=environment)
        try:
            take_pictures(folder, screen)
        finally:
            process.kill()
            process.wait(timeout=20)
    return 0


if __name__ == "__main__":
    sys.exit(main())
