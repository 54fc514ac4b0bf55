"""The lists of what the programs are made of have all of their crates, with licences, and nothing else.

Usage: sbom.py OUT_DIR

Needs cargo-cyclonedx. What `deploy/sbom` writes is compared with `cargo tree -e normal` and `cargo metadata`, and with what it
writes a second time. A list with one crate less, one more, another version or another licence must be found. Half a minute.
"""

import argparse
import copy
import json
import pathlib
import subprocess

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = {"coordinator": "descry", "worker": "descry-worker"}
TARGET = "x86_64-unknown-linux-gnu"


def output(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=REPOSITORY).stdout


def crates(program):
    """Name and version of each crate, as cargo says them."""
    tree = output("cargo", "tree", "-p", program, "-e", "normal", "--target", TARGET, "--prefix", "none", "--locked", "-f", "{p}")
    found = {tuple(line.split()[:2]) for line in tree.splitlines() if line}
    assert len(found) > 100, found
    return {(name, version.removeprefix("v")) for name, version in found}


def licences():
    metadata = json.loads(output("cargo", "metadata", "--format-version", "1", "--locked"))
    # An older way to write OR, which is not SPDX.
    return {(it["name"], it["version"]): (it["license"] or "").replace("/", " OR ") for it in metadata["packages"]}


def problems(bom, program, expected, known):
    root = bom["metadata"]["component"]
    if (root["name"], root["version"]) != (PROGRAMS[program], known_version(program, expected)):
        yield f"the program must be {PROGRAMS[program]}, got {root['name']}"
    found = [(it["name"], it["version"]) for it in bom["components"]] + [(program, root["version"])]
    if len(found) != len(set(found)):
        yield "a crate is there twice"
    if set(found) != expected:
        yield f"must have {sorted(expected - set(found))}, must not have {sorted(set(found) - expected)}"
    for it in bom["components"]:
        crate = it["name"], it["version"]
        words = " ".join(one.get("expression") or one["license"].get("id", "") for one in it.get("licenses", []))
        if not words or words.replace("/", " OR ") != known.get(crate):
            yield f"{crate}: the licence must be {known.get(crate)}, got {words}"
        is_ours = it["bom-ref"].startswith("descry:")
        if is_ours == bool(it.get("purl")) or is_ours == bool(it.get("hashes")):
            yield f"{crate}: crates from a registry, and no others, have an address and a checksum"
    references = {it["bom-ref"] for it in [root, *bom["components"]]}
    if {entry["ref"] for entry in bom["dependencies"]} != references:
        yield "dependencies must name each crate"
    if not {other for entry in bom["dependencies"] for other in entry["dependsOn"]} <= references:
        yield "dependencies must name no other crate"
    if "file://" in json.dumps(bom) or str(REPOSITORY) in json.dumps(bom):
        yield "must name no path of this machine"


def known_version(program, expected):
    return next(version for name, version in expected if name == program)


def broken(bom):
    """Lists that are wrong, and what of."""
    def changed(change):
        other = copy.deepcopy(bom)
        change(other["components"][-1], other)
        return other

    yield "a crate less", changed(lambda it, other: other["components"].remove(it))
    yield "a crate more", changed(lambda it, other: other["components"].append({**it, "name": "other"}))
    yield "a crate twice", changed(lambda it, other: other["components"].append(it))
    yield "another version", changed(lambda it, other: it.update(version="0.0.0"))
    yield "another licence", changed(lambda it, other: it.update(licenses=[{"expression": "GPL-3.0-only"}]))
    yield "no licence", changed(lambda it, other: it.pop("licenses"))
    yield "no checksum", changed(lambda it, other: it.pop("hashes"))
    yield "a path", changed(lambda it, other: it.update(description="file:///tmp"))
    yield "a dependency on nothing", changed(lambda it, other: other["dependencies"][0]["dependsOn"].append("other"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=pathlib.Path)
    out = parser.parse_args().out
    for folder in ("first", "second"):
        subprocess.run([REPOSITORY / "deploy/sbom", out / folder], check=True)
    known = licences()
    for program, installed in PROGRAMS.items():
        text = (out / "first" / f"{installed}.cdx.json").read_text()
        assert text == (out / "second" / f"{installed}.cdx.json").read_text(), f"{installed}: two lists of one commit differ"
        bom, expected = json.loads(text), crates(program)
        found = list(problems(bom, program, expected, known))
        assert not found, "\n".join(found)
        for what, other in broken(bom):
            assert list(problems(other, program, expected, known)), f"{what}: must be found, got nothing"
        print(f"{installed}: {len(expected)} crates as cargo has them; nine broken lists: all found", flush=True)


if __name__ == "__main__":
    main()
