# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes at a time, and the command line in a process of its own."""

import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import CHECKOUT, Capture, program, run, save, save_cubes
from tests.thorough import combinations

command_line = addon.module("command_line.command")


def test_jobs_report_the_same_in_the_same_order(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names with spaces, quotes, line breaks and a leading dash, objects called like files, and a broken file."""
    monkeypatch.chdir(tmp_path)
    names = ("-one", "th'r\"ee four", "fünf\n")
    for name in names:
        save_cubes(tmp_path / f"{name}.blend", "Other", "one.obj")
    (tmp_path / "bad.glb").write_bytes(b"glTF but not more")
    sources = ["bad.glb", *(f"{name}.blend" for name in names)]
    line = ["--subdivide", "--tolerance", "50mm", "--format", "stl", "--objects", "one.obj", "--json", "-"]
    reports = []
    for jobs in ([], ["--jobs", "2", "--file-timeout", "1e300"]):
        folder = tmp_path / f"out{len(jobs)}"
        folder.mkdir()
        capfd.readouterr()
        words = [*line, *jobs, "--output-folder", folder, "--", *sources]
        if jobs:
            command = [*program(), *map(str, words)]
            ended = subprocess.run(command, timeout=300, capture_output=True, text=True, cwd=tmp_path, check=False)
            status, printed, told = ended.returncode, ended.stdout, ended.stderr
        else:
            status = run(*words)
            printed, told = capfd.readouterr()
        assert status == 1, told
        assert sorted(each.name for each in folder.iterdir()) == sorted(f"{name}.stl" for name in names)
        assert "4 of 4 files done, 0 left" in told
        assert "bad.glb" in told
        assert "Traceback" not in told
        # Blender itself may have printed warnings before our command began. Each run wrote to another folder.
        files = json.loads(printed[printed.index("{\n") :])["files"]
        reports.append([{**each, "output": each["output"] and {**each["output"], "path": None}} for each in files])
    assert [each["error"] is None for each in reports[0]] == [False, True, True, True]
    assert [each["input"]["path"] for each in reports[0]] == [(tmp_path / source).as_posix() for source in sources]
    assert [entry["name"] for each in reports[0] for entry in each["objects"]] == 3 * ["one.obj"]
    assert reports[0] == reports[1]


@pytest.mark.every_blender
@pytest.mark.parametrize(("jobs", "names"), [(1, "one,deadly,broken,two"), (2, "one,deadly,two")])
def test_a_file_that_ends_its_process_takes_no_other_with_it(
    tmp_path: Path, capfd: Capture, jobs: int, names: str
) -> None:
    scene.add_object(meshes.cube())
    report, made, stems = tmp_path / "report.json", tmp_path / "out", names.split(",")
    sources = [save(tmp_path / f"{stem}.blend") for stem in stems]
    for source in sources:
        if source.stem == "broken":
            source.write_bytes(source.read_bytes()[:200])
    line = [*sources, "--subdivide", "--tolerance", "50mm", "--format", "stl", "--output-folder", made]
    assert run(*line, "--json", report, "--jobs", jobs, process=deadly_program(tmp_path)) == 1
    entries = json.loads(report.read_text(encoding="utf-8"))["files"]
    assert [each["input"]["path"] for each in entries] == [source.name for source in sources]
    errors = {each["input"]["path"]: each["error"] for each in entries if each["error"] is not None}
    ended = {Path(name).stem for name, error in errors.items() if error == "Blender ended with status -9: the end"}
    assert (ended, len(errors)) == ({"deadly"}, len(ended) + ("broken" in stems))
    assert {each.stem for each in made.iterdir()} == {"one", "two"}
    assert f"{len(sources)} of {len(sources)} files done, 0 left" in capfd.readouterr().err


def changed_program(folder: Path, changes: str) -> list[str]:
    """The command line in another process, of which something is changed; ``module`` gives its modules by name."""
    script = folder / "changed.py"
    command = [sys.executable, str(script)]
    text = f"""
import os, signal, sys, time
from importlib import import_module
from pathlib import Path
import bpy

sys.path.insert(0, {str(CHECKOUT)!r})
folder = Path({str(folder)!r})

def module(name):
    return import_module({command_line.__name__!r}.removesuffix("command") + name)

def note():
    (folder / f"{{os.getpid()}}.pid").touch()

{changes}
"""
    if bpy.app.binary_path:
        command = [bpy.app.binary_path, "-b", "--python", str(script), "--command", "ccdepth"]
    else:
        text += """
import ccdepth_addon

ccdepth_addon.register()
os._exit(module("command").run(sys.argv[1:], program="changed.py", process=[sys.executable, __file__]))
"""
    script.write_text(text, encoding="utf-8")
    return command


def deadly_program(folder: Path) -> list[str]:
    """Some files kill it, take long or stop it, by their names."""
    changes = """
def deadly_or_done(source, options):
    note()
    if source.name.startswith("deadly"):
        print("the end", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if source.name.startswith("slow"):
        time.sleep(600)
    if source.name.startswith("stopped"):
        os.kill(os.getpid(), signal.SIGSTOP)
    return done(source, options)

done, module("command").process_file = module("command").process_file, deadly_or_done
"""
    return changed_program(folder, changes)


def wait_for_end(process: int) -> None:
    """A few seconds, which it is given to break off what it does."""
    for _ in range(150):
        try:
            # Whether it is there, and not only what is left of one that has ended.
            is_running = "(zombie)" not in Path(f"/proc/{process}/status").read_text()
        except OSError:
            is_running = False
        if not is_running:
            return
        time.sleep(0.1)
    os.kill(process, signal.SIGKILL)
    pytest.fail("the process goes on")


def test_a_file_that_takes_too_long_is_ended_alone(tmp_path: Path, capfd: Capture) -> None:
    scene.add_object(meshes.cube())
    sources = [save(tmp_path / f"{each}.blend") for each in ("slow", "stopped", "good")]
    process = deadly_program(tmp_path)
    capfd.readouterr()
    # A Blender starts in less time, even where others keep the processors busy.
    assert run(*sources, "--jobs", "2", "--file-timeout", "20", "--csv", "-", process=process) == 1
    printed = capfd.readouterr()
    for name in ("slow", "stopped"):
        assert f"{name}.blend: it was not done within 20 seconds" in " ".join(printed.err.split())
    assert [("seconds" in row) for row in printed.out.splitlines()[1:]] == [True, True, False]


HANGING = """
def hang(*_):
    note()
    time.sleep(600)

module("one_file").shown_triangles = hang
"""


@pytest.mark.parametrize(
    ("ending", "jobs"),
    [
        *combinations([(signal.SIGINT, 130), (signal.SIGTERM, 143)], [["--jobs", 1], []]),
        ((signal.SIGKILL, -signal.SIGKILL), []),
    ],
)
def test_a_run_that_is_ended_while_it_writes_leaves_nothing_for_ever(
    tmp_path: Path, ending: tuple[signal.Signals, int], jobs: list[object]
) -> None:
    """What a run that was killed left is removed by the next one. With ``--jobs`` an ended run ends its Blenders."""
    number, status = ending
    source, out = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "out"
    out.mkdir()
    (out / "made.obj").write_text("precious")
    line = [source, "--subdivide", "--tolerance", "50mm", "--output", out / "made.obj", "--overwrite"]
    command = [*changed_program(tmp_path, HANGING), *map(str, [*line, *jobs])]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as started:
        end = time.monotonic() + 60
        while not (noted := list(tmp_path.glob("*.pid"))):
            assert time.monotonic() < end
            time.sleep(0.1)
        assert len(list(out.iterdir())) > 1
        started.send_signal(number)
        _, told = started.communicate(timeout=60)
    assert started.returncode == status
    assert (number == signal.SIGKILL) == ("interrupted" not in told)
    assert "Traceback" not in told
    assert (out / "made.obj").read_text() == "precious"
    if number == signal.SIGKILL:
        assert run(*line) == 0
    wait_for_end(int(noted[0].stem))
    assert [each.name for each in out.iterdir()] == ["made.obj"]


@pytest.mark.parametrize("jobs", [[], ["--jobs", "1"]])
def test_what_is_told_of_a_file_is_in_order(tmp_path: Path, jobs: list[str]) -> None:
    """In one log of the standard output and the standard error, as farms keep it; objects may have a file's name."""
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    for name in ("one", "two"):
        save_cubes(tmp_path / f"{name}.blend", f"{name}.obj")
    line = [*program(), "one.blend", "two.blend", *jobs]
    to_one = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    log = subprocess.run(line, timeout=300, cwd=tmp_path, env=buffered, check=True, **to_one).stdout
    order = [log.index("\none.obj\n"), log.index("1 of 2 files done"), log.index("\ntwo.obj\n")]
    assert order == sorted(order)
    assert log.index("2 of 2 files done") > order[-1]


# Files of each format that are broken at random. What comes of a file is its own failure, a crash or a hanging of
# Blender's importer included. Nothing of ours ends in a traceback, and what is said to be met is proved once more.


blender_calls = addon.module("exchange.blender_calls")

# Of each format, in parts that are short enough for a slice.
COUNT, PARTS = 200, 5

# The operators that write the files, and their options.
WRITERS: dict[str, tuple[str, dict[str, Any]]] = {
    ".blend": ("", {}),
    ".obj": ("wm.obj_export", {}),
    ".ply": ("wm.ply_export", {"ascii_format": True}),
    ".stl": ("wm.stl_export", {}),
    ".glb": ("export_scene.gltf", {"export_format": "GLB"}),
    ".gltf": ("export_scene.gltf", {"export_format": "GLTF_SEPARATE"}),
    ".usda": ("wm.usd_export", {}),
    ".usdc": ("wm.usd_export", {}),
    ".usdz": ("wm.usd_export", {}),
    ".fbx": ("export_scene.fbx", {}),
    ".abc": ("wm.alembic_export", {"as_background_job": False}),
}

# In bytes: a number that was changed may ask for any amount.
MOST_MEMORY = 8 << 30

SECONDS = 60


def write(path: Path) -> None:
    """Two meshes with UV maps and colours."""
    scene.clear()
    for data in (meshes.cube(), meshes.landscape(2, 1)):
        holder = scene.add_object(data)
        holder.data.uv_layers.new()
        holder.data.color_attributes.new("Color", "BYTE_COLOR", "POINT")
    operator, options = WRITERS[path.suffix]
    if path.suffix == ".blend":
        save(path, compress=False)
    elif (call := blender_calls.available(operator)) is None:
        pytest.skip(f"this Blender cannot write {path.suffix} files")
    else:
        call(filepath=str(path), **options)


def damage(content: bytearray, chance: random.Random) -> None:
    """Change bits, cut the end off, remove or repeat a part, or put another number into it, which is likelier: as text
    where there are numbers as text, else four bytes."""
    way, start = chance.randrange(6), chance.randrange(len(content))
    part = slice(start, start + chance.choice((1, 4, 64, 1024)))
    if way == 0:
        for _ in range(chance.choice((1, 1, 4, 64))):
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    elif way == 1:
        del content[start:]
    elif way == 2:
        del content[part]
    elif way == 3:
        content[start:start] = content[part]
    elif content[:1000].isascii() and (found := list(re.finditer(rb"(?<![\w.])-?\d+(\.\d+)?", content))):
        number = chance.choice(found)
        others = (b"-1", b"0", b"nan", b"inf", b"1e38", b"-1e-45", b"99999999999", b"4294967295", b"x\xff", b"")
        content[number.start() : number.end()] = chance.choice(others)
    else:
        start -= start % 4
        numbers = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\xff\x7f")
        content[start : start + 4] = chance.choice(numbers)


@pytest.mark.thorough
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("suffix", WRITERS)
def test_files_that_are_broken_at_random(tmp_path: Path, suffix: str, part: int) -> None:
    original = tmp_path / f"original{suffix}"
    write(original)
    chance = random.Random(f"{suffix} {part}")
    sources = []
    for number in range(COUNT // PARTS):
        content = bytearray(original.read_bytes())
        damage(content, chance)
        path = tmp_path / f"{number:03}{suffix}"
        path.write_bytes(content)
        sources.append(path.name)
    report, line = "report.json", ["--subdivide", "--tolerance", "10%", "--max-faces", "2000"]
    line += ["--output-folder", "made", "--format", "stl", "--jobs", "2", "--file-timeout", str(SECONDS)]
    command = [*program(), *line, "--json", report, "--", *sources]
    ended = run_in(tmp_path, command)
    assert ended.returncode in (0, 1), ended.stdout[-2000:]
    # The checkout's folder may be called so as well, and Blender with its importers be in there.
    assert not re.findall(r'File "(?!.*/site-packages/).*ccdepth.*', ended.stdout)
    content = json.loads((tmp_path / report).read_text(encoding="utf-8"))
    entries = content["files"]
    assert [each["input"]["path"] for each in entries] == sources
    for entry in entries:
        assert not re.match(r"\w+(Error|Exception|Exit)\b|ccdepth\..* went wrong", entry["error"] or ""), entry
    made = {f"{Path(entry['input']['path']).stem}.stl" for entry in entries if entry["output"]}
    assert {each.name for each in (tmp_path / "made").iterdir()} == made
    print(f"{suffix}: {len(made)} of {len(sources)} files could be done")
    # Those that are said to be well are so by themselves.
    good = [entry for entry in entries if entry["met"]]
    assert all(each["met"] for entry in good for each in entry["objects"])
    # Each by a new process: a broken .blend file harms what Blender reads after it.
    for entry in good:
        (tmp_path / "good.json").write_text(json.dumps(content | {"files": [entry], "met": True}), encoding="utf-8")
        # Blender itself may end while it reads such a file, one time and not another; then the check begins anew.
        for _ in range(20):
            checked = run_in(tmp_path, [*program(), "--verify", "good.json"])
            if checked.returncode >= 0:
                break
        assert checked.returncode == 0, checked.stdout[-2000:]


def run_in(folder: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    ways = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    ways["preexec_fn"] = lambda: resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    return subprocess.run(command, cwd=folder, timeout=3600, check=False, **ways)
