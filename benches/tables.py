#!/usr/bin/env python3
"""Measures every table of BENCHMARKS.md and prints it as Markdown, with the commit and the commands.

    ./with-vulkan python3 benches/tables.py DATA [SECTION...] > tables.md

DATA is the folder of the real data sets. It needs the release build of the program, a machine that does nothing else,
and six minutes for all sections: bytes, packed, load, jitter, clips, techniques, constant, faces, poses, crowds.
"""

import json
import os
import struct
import subprocess
import sys
import tempfile
from array import array
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target/release/deltamorph"
SETS = ["ict_facekit", "makehuman_face", "facecap_head_glb", "aura_rebuilt"]
CLIPS = [
    ("ict_facekit", "facecap_30fps.csv"),
    ("ict_facekit", "facegood_2_01_mapped_30fps.csv"),
    ("makehuman_face", "facecap_30fps.csv"),
    ("facecap_head_glb", "facecap_30fps.csv"),
    ("aura_rebuilt", "compskin_30fps.csv"),
]
data = Path()


def run(command, *arguments):
    """The JSON that a command of the program writes. Its input may be a data set, by name."""
    words = [str(data / word) if word.split("/")[0] in SETS else word for word in arguments]
    done = subprocess.run([PROGRAM, command, *words, "--quiet", "--json", "-"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def bench(*arguments):
    """The timed configurations, after the command that measures them has been printed."""
    print(f"`bench {' '.join(arguments)}`\n")
    report = run("bench", *arguments, "--no-report")
    wrong = [timed for timed in report["runs"] if not timed["verified"]]
    assert not wrong, f"{len(wrong)} configurations are wrong"
    uneven = [timed for timed in report["runs"] if (timed["rounds_ratio"] or 1) > 1.5]
    print(f"{len(uneven)} of {len(report['runs'])} configurations were uneven: rounds differ by more than 1.5 times.\n")
    return report["runs"]


def table(heads, rows):
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print()


def percent(share):
    return f"{100 * share:.1f}%"


def short(number):
    return f"{number:.3g}"


def megabytes(timed):
    return short(timed["bytes_moved"] / 1e6)


def median(timed, key="update_and_draw_ms"):
    """In milliseconds. The path `cpu` has no times of the device where nothing is drawn."""
    return (timed[key] or timed["cpu_ms"])["median"]


def technique(timed):
    """The technique, without the delta format and the batch size that were chosen for it."""
    name = timed["technique"]
    if timed["path"] == "feedback" and timed["mode"] == "rebuild":
        return "feedback, batch 1, rebuild"
    return name


def by_cell(runs):
    cells = {}
    for timed in runs:
        cells.setdefault(timed["cell"], {})[technique(timed)] = timed
    return cells


def techniques_table(runs, cell_of):
    """Cells against techniques."""
    cells = by_cell(runs)
    names = list(dict.fromkeys(name for cell in cells.values() for name in cell))
    rows = [[cell] + [cell_of(timed[name]) if name in timed else "–" for name in names] for cell, timed in cells.items()]
    table([""] + names, rows)


def play(name, clip, *options):
    return run("play", name, "--weights", f"{name}/weights/{clip}", "--path", "cpu", *options)["summary"]


def bytes_and_errors():
    print("`play FOLDER --weights CLIP --path cpu --format FORMAT --pose POSE`: share of the bytes of dense float32, error\n")
    kinds = [("fast", "float32"), ("small", "float32"), ("small", "fixed32"), ("small", "fixed16"), ("small", "rebuilt16")]
    rows, rounding = [], {}
    for name, clip in CLIPS:
        row = [f"{name}, {clip.removesuffix('.csv')}"]
        for format, pose in kinds:
            summary = play(name, clip, "--format", format, "--pose", pose)
            row.append(f"{percent(summary['bytes_share'])}, {summary['max_error_rel']:.1e}")
            worst = rounding.setdefault(pose, [0, 0])
            worst[0] = max(worst[0], summary["rounding_error_rel"])
            worst[1] = max(worst[1], summary["normal_error_deg"])
        rows.append(row)
    table(["set, clip"] + [f"`{format}`, {pose}" for format, pose in kinds], rows)
    table(["pose", "rounding", "normals"], [[pose, f"{a:.1e}", f"{b:.2g}°"] for pose, (a, b) in rounding.items()])


def packed():
    print("`pack FOLDER --format FORMAT -o FILE`\n")
    rows = []
    for name in SETS:
        row = [name]
        for format in ["small", "fast"]:
            with tempfile.TemporaryDirectory() as folder:
                made = run("pack", name, "--format", format, "-o", f"{folder}/packed.dmorph")
            size = made["delta_bytes"] + made["index_bytes"]
            row += [
                f"{size / 1e6:.2f} MB",
                percent(size / made["dense_f32_bytes"]),
                f"{made['position_error_rel']:.1e}, {made['normal_error_deg']:.2f}°",
            ]
        rows.append(row)
    table(["set", "`small`", "of dense", "error", "`fast`", "of dense", "error"], rows)


def write_glb(folder, path):
    """The positions of a folder of OBJ files as a binary glTF file: one primitive, deltas in single precision."""

    def numbers(file):
        with open(file) as lines:
            return array("f", [float(word) for line in lines if line.startswith("v ") for word in line.split()[1:4]])

    base = numbers(folder / "neutral.obj")
    with open(folder / "neutral.obj") as lines:
        faces = [[int(word.split("/")[0]) - 1 for word in line.split()[1:]] for line in lines if line.startswith("f ")]
    indices = array("I", [v for face in faces for i in range(2, len(face)) for v in (face[0], face[i - 1], face[i])])
    targets = sorted((folder / "targets").glob("*.obj"))
    deltas = [array("f", [a - b for a, b in zip(numbers(file), base)]) for file in targets]
    arrays = [indices, base, *deltas]
    views, accessors, at = [], [], 0
    for view, values in enumerate(arrays):
        size = len(values) * values.itemsize
        views.append({"buffer": 0, "byteOffset": at, "byteLength": size})
        shape = {"componentType": 5126, "type": "VEC3", "count": len(values) // 3}
        if values is indices:
            shape = {"componentType": 5125, "type": "SCALAR", "count": len(values)}
        accessors.append({"bufferView": view, **shape})
        at += size
    primitive = {"indices": 0, "attributes": {"POSITION": 1}}
    primitive["targets"] = [{"POSITION": 2 + i} for i in range(len(deltas))]
    mesh = {"primitives": [primitive], "extras": {"targetNames": [file.stem for file in targets]}}
    file = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "meshes": [mesh]}
    file |= {"buffers": [{"byteLength": at}], "bufferViews": views, "accessors": accessors}
    text = json.dumps(file).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(b"JSON", text), (b"BIN\0", b"".join(values.tobytes() for values in arrays))]
    body = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in chunks)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def load():
    print("`RAYON_NUM_THREADS=1 pack INPUT --format FORMAT -o FILE`, the fastest of five: seconds to read, and to pack\n")
    os.environ["RAYON_NUM_THREADS"] = "1"

    def fastest(source, format, output):
        runs = [run("pack", source, "--format", format, "-o", output) for _ in range(5)]
        return [min(one[key] for one in runs) for key in ["read_seconds", "pack_seconds"]] + [runs[0]["dense_f32_bytes"]]

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        packed = {format: f"{folder}/{format}.dmorph" for format in ["fast", "small"]}
        for name in ["ict_facekit", "aura_rebuilt"]:
            write_glb(data / name, Path(f"{folder}/head.glb"))
            for kind, source in [("OBJ", name), (".glb", f"{folder}/head.glb")]:
                runs = [fastest(source, format, output) for format, output in packed.items()]
                cells = [[f"{packing:.2f} s", f"{size / 1e6 / packing:.0f} MB/s"] for _, packing, size in runs]
                rows.append([f"{name}, {kind}", f"{min(read for read, *_ in runs):.3f} s", *cells[0], *cells[1]])
            reads = [fastest(source, format, f"{folder}/again.dmorph")[0] for format, source in packed.items()]
            rows.append([f"{name}, .dmorph", f"{min(reads):.3f} s", "–", "", "–", ""])
    table(["set, file", "read", "`fast`", "", "`small`", ""], rows)


def jitter():
    clip = CLIPS[1]
    options = ["--format", "small", "--noise", "0.0005"]
    print(f"`play {clip[0]} --weights {clip[1]} --path cpu {' '.join(options)}`, without and with `--error-budget 1e-4d`\n")
    without, budget = play(*clip, *options), play(*clip, *options, "--error-budget", "1e-4d")
    fewer = without["bytes_moved_mean"] / budget["bytes_moved_mean"]
    print(f"{fewer:.1f} times fewer bytes; largest error {budget['max_error_rel']:.1e}\n")


def clips():
    options = ["--suite", "clips", "--paths", "blocks,compute", "--formats", "float32,fast", "--time-limit", "3"]
    runs = bench("ict_facekit", *options)
    techniques_table(runs, lambda timed: f"{short(median(timed, 'gpu_ms'))}, {short(median(timed))}")
    for cell, timed in by_cell(runs).items():
        # The mean: nothing changes in most frames of the speech clip.
        ratio = timed["compute rebuild"]["gpu_ms"]["mean"] / timed["blocks"]["gpu_ms"]["mean"]
        print(f"{cell}: updates by `blocks` take 1/{ratio:.1f} of the time of a full evaluation, mean over the clip\n")


def techniques():
    runs = bench("--suite", "techniques", "--heads", "1", "--time-limit", "1")
    techniques_table(runs, lambda timed: short(median(timed)))


def constant():
    options = ["--vertices", "10000", "--targets", "212", "--constant", "0,28,100,200", "--poses", "float32,fixed32"]
    runs = bench("--suite", "techniques", "--heads", "1", *options, "--formats", "float32,fast", "--time-limit", "0.2")
    techniques_table(runs, lambda timed: f"{short(median(timed))} ({megabytes(timed)} MB)")


def faces():
    runs = bench("--suite", "faces", "--draws", "1,3")
    techniques_table(runs, lambda timed: f"{short(median(timed))} ({megabytes(timed)} MB)")
    error = max(timed["max_error_rel"] for timed in runs)
    print(f"largest error {error:.1e} of the diagonal\n")


def poses():
    options = ["--weights", f"ict_facekit/weights/{CLIPS[0][1]}", "--changed", "8", "--paths", "blocks"]
    options += ["--formats", "fast", "--poses", "float32,fixed32,fixed16,rebuilt16", "--frames", "400"]
    runs = bench("ict_facekit", *options, "--time-limit", "0.5", "--draws", "1,3")
    table(
        ["workload", "draws", "pose", "update and draws, ms"],
        [[timed["workload"], timed["draws"], timed["pose"], short(median(timed))] for timed in runs],
    )


def crowds():
    options = ["--heads", "1,100,1000", "--vertices", "2700", "--targets", "52", "--paths", "blocks"]
    runs = bench("--suite", "techniques", *options, "--poses", "fixed16", "--time-limit", "0.5")
    techniques_table(runs, lambda timed: f"{short(1e3 * median(timed, 'gpu_ms') / timed['heads'])} µs a head")


SECTIONS = {
    "bytes": bytes_and_errors,
    "packed": packed,
    "load": load,
    "jitter": jitter,
    "clips": clips,
    "techniques": techniques,
    "constant": constant,
    "faces": faces,
    "poses": poses,
    "crowds": crowds,
}


def main():
    global data
    if len(sys.argv) < 2 or not (Path(sys.argv[1]) / SETS[0]).is_dir():
        sys.exit(__doc__)
    data = Path(sys.argv[1]).resolve()
    chosen = sys.argv[2:] or SECTIONS
    commit = subprocess.check_output(["git", "describe", "--always", "--dirty"], cwd=ROOT, text=True).strip()
    print(f"Commit {commit}\n")
    for name in chosen:
        print(f"## {name}\n", flush=True)
        SECTIONS[name]()


main()
