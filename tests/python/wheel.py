"""The Python package: built, installed into a fresh environment, and compared with the programs.

    python3 tests/python/wheel.py target/release/coordinator OUT_DIR [WHEEL]

OUT_DIR keeps the packages of PyPI, which need the network the first time; everything else in it is made again. WHEEL is
one that was built before. The second half of this file runs inside the environment, with wheel_types.py and
wheel_notebook.py.
"""

import json
import os
import pickle
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = "docs/src/how-to/python.md"
#: Beside the wheel: what builds it, tables, the transformer's protocol, types, the notebook.
PACKAGES = ["maturin>=1.9,<2", "numpy", "polars", "scikit-learn", "mypy", "typing-extensions", "nbclient", "ipykernel"]
QUIET = ["--quiet", "--disable-pip-version-check"]


def run(*command, **options):
    done = subprocess.run([str(part) for part in command], check=False, capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def packages(out):
    """The folder of the packages; it is made once."""
    folder, wanted = out / "packages", f"{sys.version}\n{PACKAGES}\n"
    stamp = folder / "wanted.txt"
    if not stamp.exists() or stamp.read_text() != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        run(sys.executable, "-m", "pip", "install", *QUIET, "--no-compile", "--target", folder, *PACKAGES)
        stamp.write_text(wanted)
    return folder


def build(out, tools):
    # The target folder of the programs has another profile.
    target = os.environ.get("CARGO_TARGET_DIR")
    variables = dict(os.environ, CARGO_TARGET_DIR=f"{target}-python" if target else str(REPOSITORY / "python/target"))
    # What the page says, with folders of its own.
    page = (REPOSITORY / PAGE).read_text()
    lines = re.search(r"^```\n(pip install maturin\n.*?)^```$", page, re.M | re.S)[1].splitlines()
    command = shlex.split(lines[1])
    assert command[0] == "maturin" and command[-2:] == ["--out", "wheels"], command
    run(tools / "bin/maturin", *command[1:-1], out / "wheels", "--locked", env=variables, cwd=REPOSITORY)
    wheels = list((out / "wheels").glob("descry-*-abi3-*.whl"))
    assert len(wheels) == 1, f"one wheel for all Pythons expected, got {wheels}"
    return wheels[0]


def demo(coordinator, out):
    """A folder with those of the demo, as the pages have them."""
    work = out / "work"
    work.mkdir(exist_ok=True)
    if not (work / "experiments").exists():
        (work / "experiments").symlink_to(REPOSITORY / "experiments")
    if not (work / "objects").exists():
        text = (REPOSITORY / "experiments/demo.toml").read_text()
        (work / "demo.toml").write_text(text.replace("../results/data/demo", str(work / "results/data/demo")))
        run(coordinator, "run", "demo.toml", "--out", "results/runs/demo", "--listen", "127.0.0.1:0", cwd=work)
        run(coordinator, "export", "results/runs/demo", "objects", cwd=work)
    return work


def environment(out, tools, wheel):
    """Python of a fresh environment with the wheel, which finds the packages, too."""
    # Debian's Python has no pip for environments, but one that installs into them.
    run(sys.executable, "-m", "venv", "--without-pip", out / "venv")
    python = out / "venv/bin/python"
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    Path(site, "packages.pth").write_text(f"{tools}\n")
    run(sys.executable, "-m", "pip", "--python", python, "install", *QUIET, "--no-index", wheel)
    return python


def outside(coordinator, out, wheel):
    coordinator, out = Path(coordinator).resolve(), Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    os.environ["PYTHONPATH"] = ""
    for folder in ("wheels", "venv", "work"):
        shutil.rmtree(out / folder, ignore_errors=True)
    tools = packages(out)
    python = environment(out, tools, Path(wheel).resolve() if wheel else build(out, tools))
    work = demo(coordinator, out)
    variables = dict(os.environ, PATH=f"{coordinator.parent}{os.pathsep}{os.environ['PATH']}")
    command = [str(python), str(Path(__file__).resolve()), "--inside", str(coordinator)]
    sys.exit(subprocess.run(command, cwd=work, env=variables, check=False).returncode)


def pcd(path):
    """Points, colours and viewpoint of a PCD file, read without Descry."""
    from cospair import read

    xyz, rgb, viewpoint = read(path)
    return xyz, rgb.astype("uint8"), tuple(viewpoint)


def refused(error, call, what, advice=""):
    try:
        call()
    except error as refusal:
        assert what in refusal.what and advice in refusal.advice, refusal
        assert str(refusal).startswith(refusal.what) and "\n" not in refusal.what, refusal
        return refusal
    raise AssertionError(f"not refused: {what}")


def recognised(coordinator, recogniser, paths, clouds):
    """Every digit is the program's."""
    lines = run(coordinator, "recognise", "objects", *paths, "--json", "--top", 3).splitlines()
    many = recogniser.recognise_many(clouds, top=3)
    assert len(lines) == len(many) == len(paths) >= 100
    for line, cloud, answer in zip(map(json.loads, lines), clouds, many):
        assert answer == recogniser.recognise(*cloud, top=3)
        for key, value in [
            ("predicted_instance", answer.instance),
            ("predicted_category", answer.category),
            ("nearest_cloud", answer.cloud),
            ("distance", answer.distance),
            ("margin", answer.margin),
            ("unknown", answer.unknown),
            ("known_probability", answer.known_probability),
        ]:
            assert line[key] == value, (key, line, answer)
        assert [tuple(one.values()) for one in line["top"]] == [tuple(one) for one in answer.ranking]
    return many


def read_files(descry, paths, clouds):
    """Bit for bit what is read without Descry."""
    for path, (xyz, rgb, viewpoint) in zip(paths, clouds):
        cloud = descry.read_cloud(path)
        assert cloud.xyz.tobytes() == xyz.tobytes() and cloud.rgb.tobytes() == rgb.tobytes()
        assert (cloud.xyz.shape, cloud.rgb.shape, cloud.viewpoint) == (xyz.shape, rgb.shape, viewpoint)
    Path("shape.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n"
    )
    cloud = descry.read_cloud("shape.ply")
    assert cloud.xyz.tolist() == [[1, 2, 3]] and cloud.rgb is None
    refused(descry.Error, lambda: descry.read_cloud("nowhere.pcd"), "nowhere.pcd: must be a file, got nothing")
    refused(descry.Error, lambda: descry.read_cloud("."), ".: must be a file, got something else", "PLY")
    refused(descry.Error, lambda: descry.read_cloud("demo.toml"), "demo.toml: pcd header: ", "remove the line")


def described(descry, clouds):
    import numpy as np

    vector = json.loads(Path("objects/test-vector.json").read_text())
    example = pcd(Path("objects/example.pcd"))
    signature = descry.describe(example[0], example[1], "objects", example[2])
    parts = [np.array(vector[part][kind], np.float32) for part in ("shape", "colour") for kind in ("centroid", "deviation")]
    assert signature.dtype == np.float32 and signature.shape == (sum(map(len, parts)),)
    assert signature.tobytes() == np.concatenate(parts).tobytes()
    assert [part.tobytes() for pair in signature.channels for part in pair] == [part.tobytes() for part in parts]
    copied = pickle.loads(pickle.dumps(signature))
    assert copied.tobytes() == signature.tobytes() and copied.lengths == signature.lengths
    assert len(signature.copy().channels) == len(copied.channels) == 2
    for part in (signature[:5], signature[::-1], signature[np.argsort(signature)]):
        refused(descry.Error, lambda: part.channels, "channels: must be asked of a whole signature, got a part")
    file = Path("experiments/descriptors/pfhrgb.toml")
    refused(descry.Error, lambda: descry.describe(1000 * example[0], example[1], file), "as if mm were read as m", "metres")
    refused(descry.Error, lambda: descry.describe(1000 * example[0], example[1], "objects"), "as if mm were read as m")
    by_path, by_text = (descry.describe(*example[:2], of) for of in (file, file.read_text()))
    assert by_path.tobytes() == by_text.tobytes() and len(by_path.channels) == 2
    refused(descry.Error, lambda: descry.describe(example[0], None, file), "colour")
    refused(descry.Error, lambda: descry.describe(*example[:2], "version = 1\nchanel = 2"), "unknown key, got `chanel`", "known keys here")
    refused(descry.Error, lambda: descry.describe(*example[:2], "nowhere.toml"), "nowhere.toml: cannot be read")


def pipeline(descry, clouds, labels):
    import numpy as np
    from sklearn.base import clone
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline

    step = descry.Descriptor("objects")
    copy = clone(step)
    assert copy is not step and copy.get_params() == {"descriptor": "objects"}
    assert copy.set_params(descriptor="other").descriptor == "other" and step.descriptor == "objects"
    refused(descry.Error, lambda: step.set_params(radius=1), "set_params: must be descriptor, got radius")
    rows = step.fit_transform(clouds)
    for row, cloud in zip(rows, clouds[:5]):
        assert row.tobytes() == descry.describe(cloud[0], cloud[1], "objects", cloud[2]).tobytes()
    model = make_pipeline(step, KNeighborsClassifier(1)).fit(clouds[::2], labels[::2])
    right = model.predict(clouds[1::2]) == np.array(labels[1::2])
    assert right.mean() > 0.5, right.mean()


def unaligned(values):
    """The same at an odd address, as a part of a message is."""
    import numpy as np

    held = np.frombuffer(b"\0" + values.tobytes(), np.uint8)[1:]
    part = held.view(values.dtype).reshape(values.shape)
    assert values.itemsize == 1 or not part.flags.aligned
    return part


def forked(recogniser, clouds, answers):
    """A child has no thread of its parent's, and is answered all the same."""
    assert recogniser.recognise_many(clouds, top=3) == answers
    child = os.fork()
    if child == 0:
        same = False
        try:
            import descry

            same = recogniser.recognise_many(clouds, top=3) == answers
            same = same and descry.Recogniser("objects").recognise(*clouds[0], top=3) == answers[0]
        finally:
            os._exit(0 if same else 1)
    end = time.monotonic() + 120
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise AssertionError("a forked child was not answered within two minutes")
        time.sleep(0.01)
    assert status == 0, status


def arrays(descry, recogniser, cloud):
    import numpy as np

    xyz, rgb, viewpoint = cloud
    answer = recogniser.recognise(xyz, rgb, viewpoint)
    same = [
        (xyz.astype(np.float64), rgb),
        (np.asfortranarray(xyz), np.asfortranarray(rgb)),
        (np.repeat(xyz, 2, 0)[::2], np.repeat(rgb, 2, 0)[::2]),
        (xyz.tolist(), rgb),
        (unaligned(xyz), unaligned(rgb)),
    ]
    for points, colours in same:
        assert recogniser.recognise(points, colours, viewpoint) == answer
    holes = np.vstack([xyz, [[np.nan, 0, 0], [0, np.inf, 0]]]), np.vstack([rgb, [[1, 2, 3]] * 2]).astype(np.uint8)
    assert recogniser.recognise(*holes, viewpoint) == answer
    short = [
        (lambda: recogniser.recognise(xyz[:, :2], rgb), "xyz: must have the shape (n, 3), got "),
        (lambda: recogniser.recognise(xyz.ravel(), rgb), "xyz: must have the shape (n, 3), got "),
        (lambda: recogniser.recognise(xyz, rgb[:-1]), "rgb: must have the shape of xyz"),
        (lambda: recogniser.recognise(xyz, rgb / 255), "rgb: must hold uint8, got float64"),
        (lambda: recogniser.recognise(xyz.astype(str), rgb), "xyz: must hold numbers, got "),
        (lambda: recogniser.recognise(xyz, rgb, (0, 0)), "viewpoint: must be three numbers"),
        (lambda: recogniser.recognise(xyz, rgb, (0, np.nan, 0)), "viewpoint: must be finite"),
        (lambda: recogniser.recognise(xyz[:0], rgb[:0]), "points"),
        (lambda: recogniser.recognise(np.full_like(xyz, np.nan), rgb), "points"),
        (lambda: recogniser.recognise_many([cloud, (xyz[:3], rgb[:3])]), "cloud 1: "),
        (lambda: descry.Recogniser("nowhere"), "nowhere"),
        (lambda: recogniser.recognise([[1, 2, 3], [4, 5]], rgb), "xyz: must be an array, got "),
        (lambda: recogniser.recognise_many([(*cloud, 1)]), "cloud: must be xyz, (xyz, rgb) or (xyz, rgb, viewpoint), got 4"),
        (lambda: recogniser.recognise(*cloud, top=0), "top: must be a whole number from 1, got 0"),
        (lambda: recogniser.recognise_many([cloud], top="all"), "top: must be a whole number from 1, got 'all'"),
    ]
    one = recogniser.recognise(xyz, rgb, viewpoint, top=1)
    assert len(one.ranking) == 1 and one.margin == answer.margin and one.ranking == answer.ranking[:1]
    for call, what in short:
        assert refused(descry.Error, call, what).advice, what
    first, second = recogniser.recognise_many([cloud, (xyz[:3], rgb[:3])], errors="return")
    assert first == answer and isinstance(second, descry.Error)


def threads(recogniser, clouds, answers):
    """Several threads at once; while the compiled half works, Python goes on."""
    results = [None] * 4

    def work(index):
        results[index] = [recogniser.recognise(*cloud, top=3) for cloud in clouds]

    workers = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert all(result == answers for result in results)
    ended, begun, steps = threading.Event(), threading.Event(), 0

    def long():
        begun.set()
        recogniser.recognise_many(clouds * 10)
        ended.set()

    worker = threading.Thread(target=long)
    worker.start()
    begun.wait()
    while not ended.is_set():
        steps += 1
    worker.join()
    # With the lock held, at most the few steps before and after the call.
    assert steps > 100_000, steps


def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def memory(recogniser, clouds):
    def some(count):
        for index in range(count):
            recogniser.recognise(*clouds[index % len(clouds)])

    some(1000)
    before = resident()
    some(10_000)
    grown = resident() - before
    print(f"resident after 10000 clouds: {grown / 1024:.0f} KiB more")
    assert grown < 4 << 20, grown


def tables(coordinator, descry):
    found = descry.Run("results/runs/demo")
    assert {"run", "generations", "evaluations", "predictions"} <= set(found.tables()), found.tables()
    for sql in [
        "SELECT COUNT(*) AS n, MAX(best_fitness) AS best FROM generations",
        'SELECT "R1", MIN(object_error) AS error FROM evaluations GROUP BY "R1" ORDER BY error, "R1"',
        "SELECT cloud, distance FROM predictions WHERE split = 'test' ORDER BY query LIMIT 20",
    ]:
        expected = json.loads(run(coordinator, "query", "results/runs/demo", sql, "--format", "json"))
        assert found.query(sql).rows(named=True) == expected, sql
    row = json.loads(run(coordinator, "query", "results/runs/demo", "SELECT run_digest FROM run", "--format", "json"))
    assert found.summary["run_digest"] == row[0]["run_digest"]
    winner = found.winner
    assert winner["generation"] == found.summary["winner_generation"] and 0 < winner["R1"] < winner["R2"]
    svg = found.figure("convergence")._repr_svg_()
    assert svg.lstrip().startswith("<svg") and svg.rstrip().endswith("</svg>"), svg[:80]
    refused(descry.Error, lambda: found.figure("nothing"), "must have the figure, got 'nothing'", "convergence")
    refused(descry.Error, lambda: found.table("nothing"), "must have the table, got 'nothing'", "generations")
    refused(descry.Error, lambda: descry.Run("objects/none"), "must be a run folder")
    paths, os.environ["PATH"] = os.environ["PATH"], ""
    refused(descry.Error, lambda: found.figure("convergence"), "coordinator: must be on the path")
    os.environ["PATH"] = paths


def pages(cloud):
    """The examples of README and book."""
    for page in ("README.md", PAGE):
        blocks = re.findall(r"^```py\n(.*?)^```$", (REPOSITORY / page).read_text(), re.M | re.S)
        assert blocks, f"{page}: no example"
        # The README's run is in the folder that a run has without `--out`.
        code = re.sub(r"results/runs/demo-[0-9a-f]{12}", "results/runs/demo", "".join(blocks))
        xyz, rgb, _ = cloud
        exec(compile(code, page, "exec"), {"xyz": xyz, "rgb": rgb})


def inside(coordinator):
    import descry
    import wheel_notebook
    import wheel_types

    paths = sorted(Path("results/data/demo").glob("*/*/*_2_*.pcd"))[:120]
    clouds = [pcd(path) for path in paths]
    read_files(descry, paths, clouds)
    recogniser = descry.Recogniser("objects")
    answers = recognised(coordinator, recogniser, paths, clouds)
    described(descry, clouds)
    pipeline(descry, clouds, [path.parent.name for path in paths])
    arrays(descry, recogniser, clouds[0])
    threads(recogniser, clouds, answers)
    forked(recogniser, clouds[:20], answers[:20])
    memory(recogniser, clouds)
    tables(coordinator, descry)
    pages(clouds[0])
    wheel_types.check(descry, Path("../mypy").resolve())
    wheel_notebook.check(Path.cwd())
    print(f"the wheel answers as the programs do: {len(answers)} clouds")


if __name__ == "__main__":
    if sys.argv[1] == "--inside":
        inside(sys.argv[2])
    else:
        outside(sys.argv[1], sys.argv[2], sys.argv[3] if len(sys.argv) > 3 else None)
