"""The C library: built, installed, called from C and C++, and compared with the programs.

    python3 tests/python/c_library.py target/release/coordinator OUT_DIR [--latency]

Needs a C and a C++ compiler, make, pkg-config, numpy (PYTHONPATH) and valgrind; without PCL (libpcl-dev) the example with
PCL is left out, unless DESCRY_REQUIRE_PCL=1. `--latency` measures instead, on one core, beside PCL; it needs the benchmark
data (DESCRY_SHARED), whose 943 training and validation clouds the answers are found among.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from wheel import REPOSITORY, demo, pcd, run

PAGE = "docs/src/how-to/c.md"
WARNINGS = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
#: Ways to compile the same sources: the language's own compilers, as C99, as C17 and as C++.
DIALECTS = [("gcc", "-std=c99"), ("gcc", "-std=c17"), ("g++", "-x", "c++", "-std=c++11")]
PCL = "pcl_io"


def versions():
    for command in (["gcc", "--version"], ["g++", "--version"], ["valgrind", "--version"], ["rustc", "--version"]):
        print(run(*command).splitlines()[0])


def variables(out):
    """Where cargo builds, and where compilers and loaders find what was installed."""
    # The target folder of the programs has another profile.
    target = os.environ.get("CARGO_TARGET_DIR", str(REPOSITORY / "target"))
    prefix = out / "work/local"
    return dict(
        os.environ,
        CARGO_TARGET_DIR=str(Path(f"{target}/c").resolve()),
        PKG_CONFIG_PATH=f"{prefix}/lib/pkgconfig",
        LD_LIBRARY_PATH=f"{prefix}/lib",
    )


def blocks(language=""):
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", (REPOSITORY / PAGE).read_text(), re.M | re.S)
    return [text for of, text in fences if of == language]


def page(work, env):
    """What the page shows, as it is written there: the library is installed, and its program is compiled and run."""
    if not (work / "c").exists():
        (work / "c").symlink_to(REPOSITORY / "c")
    (program,) = blocks("c")
    (work / "objects.c").write_text(program)
    xyz, rgb, _ = pcd(work / "objects/example.pcd")
    (numpy,) = blocks("py")
    exec(compile(numpy.replace("cloud.", f"{work}/cloud."), PAGE, "exec"), {"xyz": xyz, "rgb": rgb})
    commands = blocks()
    assert len(commands) == 4, PAGE
    said = run("bash", "-euc", "".join(commands), cwd=work, env=env).splitlines()
    right = json.loads((work / "objects/test-vector.json").read_text())
    name, category, distance = right["predicted_instance"], right["predicted_category"], right["distance"]
    # The program of the page, linked in both ways, and the example.
    assert said.count(f"{name} {distance:.6f}") == 2, said
    assert f"cloud.xyz: {name} ({category}), distance {distance:.6f}" in said, said
    assert any(line.startswith("cloud.xyz: signature of ") for line in said), said


def sources(env):
    """The committed header is that of the sources; format and lints, which the workspace's do not reach."""
    done = run("cargo", "test", "--release", "--locked", cwd=REPOSITORY / "c", env=env)
    assert "the_header_is_that_of_the_sources ... ok" in done, done
    linked = run("cargo", "tree", "--locked", "-e", "normal", "--prefix", "none", cwd=REPOSITORY / "c", env=env)
    names = {line.split(" ")[0] for line in linked.splitlines()}
    heavy = {"tokio", "tonic", "polars", "reqwest", "openssl", "aws-lc-rs"}
    assert "artefact" in names and not names & heavy, names & heavy
    run("cargo", "fmt", "--check", cwd=REPOSITORY / "c", env=env)
    lints = ["clippy", "--release", "--all-targets", "--locked", "--", "-D", "warnings"]
    run("cargo", *lints, cwd=REPOSITORY / "c", env=env)


def compiled(out, env, source, name, *ways):
    """Programs, one for each way to compile them."""
    flags = run("pkg-config", "--cflags", "--libs", "descry_recognise", env=env).split()
    programs = []
    for number, way in enumerate(ways or DIALECTS):
        program = out / f"{name}-{number}"
        run(way[0], *WARNINGS, "-O1", "-g", *way[1:], source, "-o", program, *flags, "-pthread", "-lm", "-ldl")
        programs.append(program)
    return programs


def linked_statically(out, env, source):
    """Without the shared library, with what the pkg-config file says that the static one needs."""
    include = run("pkg-config", "--cflags", "descry_recognise", env=env).split()
    directory = run("pkg-config", "--variable=libdir", "descry_recognise", env=env).strip()
    private = run("pkg-config", "--static", "--libs-only-l", "descry_recognise", env=env).split()
    private.remove("-ldescry_recognise")
    program = out / "static"
    run("gcc", *WARNINGS, "-std=c99", source, *include, f"{directory}/libdescry_recognise.a", *private, "-o", program)
    assert "descry" not in run("ldd", program), "linked with the shared library"
    return program


def installed(env):
    """The library has one name for programs, and exports nothing but its interface."""
    library = Path(env["LD_LIBRARY_PATH"]) / "libdescry_recognise.so"
    dynamic = run("readelf", "-d", library)
    (name,) = re.findall(r"Library soname: \[(.*?)\]", dynamic)
    assert (library.parent / name).exists() and "NODELETE" in dynamic, dynamic
    symbols = {line.split()[-1] for line in run("nm", "-D", "--defined-only", library).splitlines()}
    declared = set(re.findall(r"\b(descry_\w+)\(", re.sub(r"/\*.*?\*/", "", header_text(), flags=re.S)))
    assert symbols == declared and len(declared) == 10, symbols ^ declared
    version = run("pkg-config", "--modversion", "descry_recognise", env=env).strip()
    (own,) = re.findall(r'^version = "(.*)"', (REPOSITORY / "c/Cargo.toml").read_text(), re.M)
    assert version == own, version
    needed = re.findall(r"Shared library: \[(.*?)\]", dynamic)
    size = library.resolve().stat().st_size / 2**20
    print(f"library {version}, {size:.1f} MiB, needs {' '.join(needed)}")


def header_text():
    return (REPOSITORY / "c/include/descry_recognise.h").read_text()


def moved_cameras(work, paths):
    """Copies of the clouds, seen from beside the object: all others are seen from the origin."""
    folder = work / "moved"
    folder.mkdir(exist_ok=True)
    copies = []
    for path in paths:
        text = path.read_bytes()
        assert text.count(b"\nVIEWPOINT 0 0 0 ") == 1, path
        copies.append(folder / path.name)
        copies[-1].write_bytes(text.replace(b"\nVIEWPOINT 0 0 0 ", b"\nVIEWPOINT 0.4 0.1 0.9 "))
    return copies


def raw_clouds(work, paths):
    """The clouds as plain numbers, and the list of them."""
    folder = work / "raw"
    folder.mkdir(exist_ok=True)
    lines = []
    for index, path in enumerate(paths):
        xyz, rgb, viewpoint = pcd(path)
        (folder / f"{index}.xyz").write_bytes(xyz.astype("<f4").tobytes())
        (folder / f"{index}.rgb").write_bytes(rgb.tobytes())
        lines.append(f"{folder}/{index}.xyz {folder}/{index}.rgb {' '.join(repr(float(one)) for one in viewpoint)}\n")
    (work / "clouds.txt").write_text("".join(lines))
    (work / "few.txt").write_text("".join(lines[:6]))
    return work / "clouds.txt", work / "few.txt"


def artefacts(coordinator, work):
    """Of each kind: by the nearest cloud, learned, of a structure, and of too few objects for a rule about unknown ones."""
    of_run = ["export", "results/runs/demo"]
    structure = ["--structure", "experiments/descriptors/chroma.toml"]
    if not (work / "structure").exists():
        run(coordinator, *of_run, "learned", "--recogniser", "projection", cwd=work)
        run(coordinator, *of_run, "structure", *structure, "--recogniser", "kernel-ridge", cwd=work)
    if not (work / "believing").exists():
        text = (work / "demo.toml").read_text().replace("data/demo", "data/two").replace("objects = 18", "objects = 2")
        (work / "two.toml").write_text(text.replace("generations = 20", "generations = 1"))
        run(coordinator, "run", "two.toml", "--out", "results/runs/two", "--listen", "127.0.0.1:0", cwd=work)
        run(coordinator, "export", "results/runs/two", "believing", cwd=work)
    return [work / name for name in ("objects", "learned", "structure", "believing")]


def expected(coordinator, artefact, paths, work):
    """What the program answers, as the lines of check.c."""
    found = run(coordinator, "recognise", artefact, *paths, "--json", "--top", 3, cwd=work).splitlines()
    answers = []
    for line in map(json.loads, found):
        top = [[one["instance"], one["category"], one["cloud"], one["distance"]] for one in line["top"]]
        answers.append([line.get("unknown", False), line.get("known_probability", -1.0), top])
    assert len(answers) == len(paths) > 400, len(answers)
    if artefact.name == "objects":
        moved = {path.name: top for path, (*_, top) in zip(paths, answers) if path.parent.name == "moved"}
        stayed = {path.name: top for path, (*_, top) in zip(paths, answers) if path.parent.name != "moved"}
        assert len(moved) > 40 and any(top != stayed[name] for name, top in moved.items()), "the camera says nothing"
    return answers


def read_answers(text):
    answers = []
    for line in text.splitlines():
        unknown, probability, *parts = line.split("\t")
        named = [[*parts[at : at + 3], float(parts[at + 3])] for at in range(0, len(parts), 4)]
        answers.append([unknown == "1", float(probability), named])
    return answers


def answers(coordinator, work, env, programs, static, paths, everything):
    """Every digit is the program's, on eight threads, of every kind of artefact and every build."""
    for artefact in artefacts(coordinator, work):
        right = expected(coordinator, artefact, paths, work)
        for program in [programs[0], static] if artefact.name != "objects" else [*programs, static]:
            got = read_answers(run(program, "answers", artefact, everything, 3, 8, env=env))
            assert got == right, (artefact, program)
        unknown, has_rule = sum(answer[0] for answer in right), right[0][1] >= 0
        assert has_rule == (artefact.name != "believing") and (unknown > 0 or artefact.name != "objects"), artefact
        print(f"{artefact.name}: {len(right)} clouds answered as by the program, {unknown} of them unknown")


def signatures(work, env, program):
    """Those of the artefact's own test vector."""
    import numpy as np

    vector = json.loads((work / "objects/test-vector.json").read_text())
    (work / "example").mkdir(exist_ok=True)
    everything, _ = raw_clouds(work / "example", [work / "objects/example.pcd"])
    lengths = run(program, "signatures", work / "objects", everything, work / "values", env=env).splitlines()
    parts = [vector[part] for part in ("shape", "colour")]
    assert lengths == [f"{len(part['centroid'])} {len(part['deviation'])}" for part in parts], lengths
    right = np.concatenate([np.array(part[kind], "<f4") for part in parts for kind in ("centroid", "deviation")])
    assert (work / "values").read_bytes() == right.tobytes()


def broken(work):
    """What is no artefact."""
    folder = work / "broken"
    shutil.rmtree(folder, ignore_errors=True)
    sound = work / "objects"
    for name in ("settings", "database", "no-database", "version", os.fsdecode(b"\xe4\xff")):
        shutil.copytree(sound, folder / name)
    (folder / "empty").mkdir()
    (folder / "file").write_text("")
    settings = (sound / "descriptor.toml").read_text()
    (folder / "settings/descriptor.toml").write_text(settings.replace("leaf_cm = 2", "leaf_cm = 3"))
    (folder / "version/descriptor.toml").write_text(re.sub(r"(?m)^version = \d+$", "version = 99", settings, count=1))
    database = bytearray((sound / "database.parquet").read_bytes())
    database[len(database) // 2] ^= 1
    (folder / "database/database.parquet").write_bytes(database)
    (folder / "no-database/database.parquet").unlink()
    return folder


def valgrind(env, *command):
    """No invalid access, and no memory that is lost."""
    flags = ["--quiet", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite,indirect,possible"]
    run("valgrind", *flags, *command, env=env)


def memory(work, env, program, everything):
    for line in run(program, "memory", work / "objects", everything, 10_000, env=env).splitlines():
        grown, what = line.split()
        print(f"resident after 10000 {what}: {grown} KiB more" if what == "clouds" else f"after 100 {what}: {grown} KiB more")
        assert int(grown) < 1024, line


def with_pcl(out, env, source, *options, modules=(PCL,)):
    """A program that uses PCL, whose own headers have warnings."""
    flags = run("pkg-config", "--cflags", "--libs", "descry_recognise", *modules, env=env).split()
    flags = [re.sub(r"^-I(?=.*(pcl|eigen|vtk))", "-isystem", flag) for flag in flags]
    program = out / source.stem
    run("g++", "-std=c++17", *options, *WARNINGS, source, "-o", program, *flags, env=env)
    return program


def pcl_version():
    return run("pkg-config", "--modversion", PCL).strip()


def pcl(out, work, env, paths, right):
    """PCL reads the clouds; the answers are the program's."""
    if subprocess.run(["pkg-config", PCL], check=False).returncode:
        assert os.environ.get("DESCRY_REQUIRE_PCL") != "1", f"pkg-config does not know {PCL}"
        print("SKIPPED: no PCL, the example with it is not compiled")
        return
    program = with_pcl(out, env, REPOSITORY / "c/examples/recognise_pcl.cpp", "-O1")
    said = run(program, work / "objects", *paths, env=env).splitlines()
    assert len(said) == len(right)
    for path, line, (unknown, _, top) in zip(paths, said, right):
        instance, category, _, distance = top[0]
        named = f"{path}: {'unknown, most like ' if unknown else ''}{instance} ({category}), distance "
        assert line.startswith(named) and float(line[len(named) :]) == distance, (line, named)
    refused = subprocess.run([program, work / "nowhere", paths[0]], check=False, capture_output=True, text=True, env=env)
    assert refused.returncode == 1 and "nowhere/descriptor.toml: cannot be read" in refused.stderr, refused
    print(f"PCL {pcl_version()}: {len(said)} clouds answered as by the program")


def latency(coordinator, out, work, env):
    """Rows of the page's table: the paper's descriptor beside PCL's."""
    run("make", "-C", REPOSITORY / "c", "install", f"PREFIX={work}/local", env=env)
    if not (work / "household").exists():
        shared = Path(os.environ.get("DESCRY_SHARED", REPOSITORY / "../shared")).resolve()
        text = (REPOSITORY / "experiments/household.toml").read_text()
        text = re.sub(r'root = ".*?"', f'root = "{shared}/data/household-rgbd"', text)
        (work / "household.toml").write_text(text.replace("generations = 200", "generations = 1"))
        run(coordinator, "run", "household.toml", "--out", "results/runs/household", "--listen", "127.0.0.1:0", cwd=work)
        run(coordinator, "export", "results/runs/household", "household", "--descriptor", "paper", cwd=work)
    modules = [f"pcl_{module}" for module in ("features", "filters", "search", "common")]
    program = with_pcl(out, env, REPOSITORY / "tests/c/latency.cpp", "-O3", "-DNDEBUG", modules=modules)
    core = sorted(os.sched_getaffinity(0))[-1]
    command = ["taskset", "-c", core, program, work / "household", 1000, 5000, 20_000, 50_000]
    print(re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())[0], "PCL", pcl_version())
    subprocess.run([str(part) for part in command], check=True, env=env)


def main(coordinator, out, mode=""):
    coordinator, out = Path(coordinator).resolve(), Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    versions()
    work, env = demo(coordinator, out), variables(out)
    if mode == "--latency":
        latency(coordinator, out, work, env)
        return
    page(work, env)
    sources(env)
    installed(env)
    paths = sorted((work / "results/data/demo").glob("*/*/*.pcd"))
    paths += moved_cameras(work, paths[::10])
    everything, few = raw_clouds(work, paths)
    check = REPOSITORY / "tests/c/check.c"
    programs = compiled(out, env, check, "check")
    compiled(out, env, REPOSITORY / "c/examples/recognise.c", "recognise")
    (reload,) = compiled(out, env, REPOSITORY / "tests/c/reload.c", "reload", ("gcc", "-std=c99", "-Wl,--as-needed"))
    answers(coordinator, work, env, programs, linked_statically(out, env, check), paths, everything)
    signatures(work, env, programs[0])
    damaged = broken(work)
    for program in programs:
        run(program, "misuse", work / "objects", few, damaged, env=env)
    run(programs[0], "large", work / "objects", env=env)
    run(reload, f"{env['LD_LIBRARY_PATH']}/libdescry_recognise.so", work / "learned", cwd=work, env=env)
    memory(work, env, programs[0], everything)
    valgrind(env, programs[0], "misuse", work / "objects", few, damaged)
    valgrind(env, programs[0], "answers", work / "objects", few, 3, 4)
    valgrind(env, programs[0], "signatures", work / "objects", few, work / "values")
    pcl(out, work, env, paths, expected(coordinator, work / "objects", paths, work))
    print("the C library answers as the programs do")


if __name__ == "__main__":
    main(*sys.argv[1:4])
