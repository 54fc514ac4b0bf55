"""A dry run of `deploy/release` on a copy of the repository: what it writes, and that each of its checks bites.

Usage: release.py PROGRAMS OUT_DIR

PROGRAMS is the folder of `coordinator`, `worker` and `write-manual`, for example target/release. Needs what a dry run of
`deploy/release` needs, and gpg. The copy has the commit that is checked out; where CHANGELOG.md says "Unreleased", it has the
version and the date, as on the day of the release. The programs are copies that name its commit instead of the one that they
were built from. What is written is checked against SHA256SUMS, the signature of a key that is made for this, the programs and
the changelog; a changed file must not pass. Then one thing after the other is made wrong. Ten minutes.
"""

import argparse
import contextlib
import datetime
import io
import json
import os
import pathlib
import re
import shutil
import subprocess
import tarfile
import tempfile
import tomllib

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = ("coordinator", "worker")
WHO = ["-c", "user.name=release test", "-c", "user.email=release@example.org"]
KEY = "release@example.org"


def run(*command, code=0, **options):
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)
    assert done.returncode == code, f"{command}: must end with {code}, got {done.returncode}\n{done.stdout}"
    return done.stdout.strip()


def say(what):
    print(what, flush=True)


class Copy:
    """A clone in which one release is due."""

    def __init__(self, folder, programs):
        self.folder, self.given, self.programs = folder / "repository", programs, folder / "programs"
        shutil.rmtree(folder, ignore_errors=True)
        run("git", "clone", "--quiet", "--no-tags", REPOSITORY, self.folder)
        self.git("remote", "remove", "origin")
        self.version = tomllib.loads(self.read("Cargo.toml"))["workspace"]["package"]["version"]
        # As if the version of this commit were about to be released: later, it is, and has a section already, or the changes
        # since then have none yet.
        self.today = f"## {self.version} – {datetime.date.today()}"
        text = re.sub(rf"^## (Unreleased|{re.escape(self.version)} – .*)\n+", "", self.read("CHANGELOG.md"), flags=re.MULTILINE)
        before, first, after = text.partition("\n- ")
        assert first and "\n## " not in before, f"CHANGELOG.md: must begin with an entry of {self.version}, got {before}"
        self.write("CHANGELOG.md", f"{before}\n{self.today}\n{first}{after}")
        releases = self.folder / "tests/releases.toml"
        if releases.exists():
            known = re.split(r"(?m)^(?=\[)", releases.read_text())
            releases.write_text("".join(part for part in known if f'"{self.version}"' not in part))
        self.commit()
        self.start = self.head()

    def git(self, *words):
        return run("git", *WHO, *words, cwd=self.folder)

    def head(self):
        return self.git("rev-parse", "HEAD")

    def read(self, path):
        return (self.folder / path).read_text()

    def write(self, path, text):
        (self.folder / path).write_text(text)

    def replace(self, path, old, new):
        text = self.read(path)
        assert old in text, f"{path}: must have {old!r}"
        self.write(path, text.replace(old, new, 1))

    def commit(self):
        self.git("commit", "--quiet", "--all", "--allow-empty", "--no-gpg-sign", "--message", "release")
        self.stamp(*PROGRAMS)

    def stamp(self, *names):
        """Programs that say that they are of the commit that is checked out: its digits, in the place of others."""
        self.programs.mkdir(exist_ok=True)
        shutil.copy(self.given / "write-manual", self.programs)
        for name in names:
            shown = run(self.given / name, "--version")
            built = re.search(r"\(commit ([0-9a-f]{9}),", shown)[1].encode()
            contents = (self.given / name).read_bytes()
            assert contents.count(built) == 1, f"{name}: must have its commit once, got {contents.count(built)}"
            (self.programs / name).unlink(missing_ok=True)
            (self.programs / name).write_bytes(contents.replace(built, self.head()[:9].encode()))
            (self.programs / name).chmod(0o755)

    def reset(self):
        self.git("checkout", "--quiet", "--force", "--detach", self.start)
        self.git("clean", "--quiet", "--force", "-d")
        self.stamp(*PROGRAMS)

    def release(self, out, *more, version=None, code=0):
        dry = ["--dry-run", "--programs", self.programs]
        return run(self.folder / "deploy/release", version or self.version, out, *dry, *more, code=code)


@contextlib.contextmanager
def key():
    """A key that signs and is gone afterwards, with a program that answers for it."""
    with tempfile.TemporaryDirectory() as home:  # its name is short enough for a socket
        before = os.environ.get("GNUPGHOME")
        os.environ["GNUPGHOME"] = home
        try:
            run("gpg", "--batch", "--quiet", "--passphrase", "", "--quick-generate-key", KEY, "ed25519", "sign", "never")
            yield
        finally:
            run("gpgconf", "--kill", "gpg-agent")
            del os.environ["GNUPGHOME"]
            if before is not None:
                os.environ["GNUPGHOME"] = before


def in_tar(contents):
    with tarfile.open(fileobj=io.BytesIO(contents)) as tar:
        return {entry.name.removeprefix("./"): tar.extractfile(entry).read() for entry in tar if entry.isfile()}


def in_image(path):
    """The files of an image's layers."""
    outer = in_tar(path.read_bytes())
    [manifest] = json.loads(outer["manifest.json"])
    return {name: contents for layer in manifest["Layers"] for name, contents in in_tar(outer[layer]).items()}


def contents(copy, out):
    """Each artefact is there and has what it is for; all have the same programs."""
    version = copy.version
    packages = [f"descry-{version}-x86_64-linux.tar.gz", f"descry_{version}_amd64.deb", f"descry-{version}-x86_64-oci.tar"]
    expected = {*packages, f"descry-{version}-kubernetes.tar.gz", "descry.cdx.json", "descry-worker.cdx.json",
                f"CHANGELOG-{version}.md", "DRY-RUN", "SHA256SUMS", "SHA256SUMS.asc"}
    found = {path.name for path in out.iterdir()}
    assert found == expected, f"must have {sorted(expected)}, got {sorted(found)}"
    listed = {line.split("  ")[1] for line in (out / "SHA256SUMS").read_text().splitlines()}
    assert listed == expected - {"SHA256SUMS", "SHA256SUMS.asc"}, listed

    stem = packages[0].removesuffix(".tar.gz")
    tarball = in_tar((out / packages[0]).read_bytes())
    package = in_tar(subprocess.run(["dpkg-deb", "--fsys-tarfile", out / packages[1]], check=True, capture_output=True).stdout)
    image = in_image(out / packages[2])
    for built, installed in zip(PROGRAMS, ("descry", "descry-worker")):
        programs = [tarball[f"{stem}/bin/{installed}"], package[f"usr/bin/{installed}"], image[f"usr/bin/{built}"]]
        assert programs[0] == programs[1] == programs[2], f"{installed}: packages and image must have the same program"
    units = [path for path in copy.git("ls-files", "deploy/systemd").splitlines() if path.endswith(".service")]
    assert len(units) == 2, units
    for unit in units:
        text, name = (copy.folder / unit).read_bytes(), unit.split("/")[-1]
        assert tarball[f"{stem}/share/doc/descry/systemd/{name}"] == package[f"lib/systemd/system/{name}"] == text, unit
    manifests = in_tar((out / f"descry-{version}-kubernetes.tar.gz").read_bytes())
    tracked = copy.git("ls-files", "deploy/kubernetes").splitlines()
    below = f"descry-{version}-kubernetes"
    assert set(manifests) == {path.replace("deploy/kubernetes", below) for path in tracked}, set(manifests)
    assert f"localhost/descry:{version}".encode() in manifests[f"{below}/coordinator.yaml"]
    notes, changelog = (out / f"CHANGELOG-{version}.md").read_text(), copy.read("CHANGELOG.md")
    section = changelog.split(f"{copy.today}\n")[1].split("\n## ")[0].strip()
    assert notes == f"{copy.today}\n\n{section}\n" and len(section) > 100, notes
    say(f"{len(found)} files; packages and image have the same programs; the notes are the changelog's section")


def verified(out):
    """What a user does with what was published; a changed file and a changed list must not pass."""
    signature = ["gpg", "--batch", "--verify", "SHA256SUMS.asc", "SHA256SUMS"]
    sums = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    run(*sums, cwd=out)
    run(*signature, cwd=out)
    notes, listed = next(out.glob("CHANGELOG-*")), out / "SHA256SUMS"
    before = notes.read_text(), listed.read_text()
    notes.write_text(before[0] + "\n")
    said = run(*sums, code=1, cwd=out)
    assert f"{notes.name}: FAILED" in said, said
    # Who changes the list as well has no key.
    listed.write_text(re.sub(rf"\S+(?=  {notes.name})", run("sha256sum", notes).split()[0], before[1]))
    run(*sums, cwd=out)
    said = run(*signature, code=1, cwd=out)
    assert "BAD signature" in said, said
    notes.write_text(before[0])
    listed.write_text(before[1])
    run(*sums, cwd=out)
    run(*signature, cwd=out)
    say("sums and signature verify; a changed file and a changed list do not")


def dirty(copy):
    copy.write("stray.txt", "")


def manifest(copy):
    copy.replace("python/pyproject.toml", f'version = "{copy.version}"', 'version = "9.9.9"')
    copy.commit()


def image_tag(copy):
    copy.replace("deploy/kubernetes/worker.yaml", f"localhost/descry:{copy.version}", "localhost/descry:9.9.9")
    copy.commit()


def page(copy):
    copy.replace("docs/src/how-to/install.md", f"descry_{copy.version}_amd64.deb", "descry_9.9.9_amd64.deb")
    copy.commit()


def no_section(copy):
    copy.replace("CHANGELOG.md", copy.today, f"## {copy.version}")
    copy.commit()


def no_date(copy):
    copy.replace("CHANGELOG.md", copy.today, f"## {copy.version} – 2026-02-30")
    copy.commit()


def empty_section(copy):
    before, _, rest = copy.read("CHANGELOG.md").partition(copy.today)
    copy.write("CHANGELOG.md", before + copy.today + "\n" + rest[rest.index("\n## "):])
    copy.commit()


def unreleased(copy):
    copy.replace("CHANGELOG.md", copy.today, f"## Unreleased\n\n- More.\n\n{copy.today}")
    copy.commit()


def toolchain(copy):
    text = copy.read("python/Cargo.toml")
    copy.write("python/Cargo.toml", re.sub(r'rust-version = ".*"', 'rust-version = "1.90"', text))
    copy.commit()


def tag(copy):
    copy.git("tag", f"v{copy.version}")


def tag_elsewhere(copy):
    """At another repository alone."""
    other = copy.folder.with_name("remote")
    run("git", "init", "--quiet", "--bare", other)
    copy.git("remote", "add", "origin", other)
    copy.git("push", "--quiet", "origin", f"HEAD:refs/tags/v{copy.version}")


def licence(copy):
    copy.replace("deny.toml", '    "MIT",\n', "")
    copy.commit()


def other_commit(copy):
    """Only the worker is of this one."""
    before = (copy.programs / "coordinator").read_bytes()
    copy.commit()
    (copy.programs / "coordinator").write_bytes(before)


def released(copy):
    known = copy.read("tests/releases.toml")
    copy.write("tests/releases.toml", f'{known}\n[[release]]\nversion = "{copy.version}"\ncommit = "{copy.head()}"\n')
    copy.git("add", "tests/releases.toml")
    copy.commit()


def several(copy):
    no_section(copy)
    dirty(copy)


# What is made wrong, and where the complaints must be.
FAULTS = {
    dirty: ["working tree"],
    manifest: ["python/pyproject.toml"],
    image_tag: ["deploy/kubernetes/worker.yaml"],
    page: ["docs/src/how-to/install.md"],
    no_section: ["CHANGELOG.md"],
    no_date: ["CHANGELOG.md"],
    empty_section: ["CHANGELOG.md"],
    unreleased: ["CHANGELOG.md"],
    toolchain: ["python/Cargo.toml"],
    tag: ["tag v{version}"],
    tag_elsewhere: ["tag v{version}"],
    licence: ["Cargo.toml", "python/Cargo.toml", "c/Cargo.toml"],
    other_commit: ["{programs}/coordinator"],
    released: ["tests/releases.toml"],
    several: ["working tree", "CHANGELOG.md"],
}


def complaints(said):
    """Where the faults are that were named, each place once."""
    lines = said.splitlines()
    places = [line.split(": ")[0] for line, advice in zip(lines, lines[1:]) if advice.startswith("  ") and ": " in line]
    return list(dict.fromkeys(places))


def faults(copy, out):
    for fault, places in FAULTS.items():
        copy.reset()
        fault(copy)
        said = copy.release(out, code=1)
        expected = [place.format(version=copy.version, programs=copy.programs) for place in places]
        assert complaints(said) == expected, f"{fault.__name__}: must name {expected}, got\n{said}"
        assert "nothing was built" in said and not out.exists(), said
        say(f"{fault.__name__}: {', '.join(expected)}")
        if fault is tag:
            copy.git("tag", "--delete", f"v{copy.version}")
        if fault is tag_elsewhere:
            copy.git("remote", "remove", "origin")
    copy.reset()
    said = copy.release(out, version="9.9.9", code=1)
    assert {"Cargo.toml", "c/Cargo.lock", "python/pyproject.toml", "CHANGELOG.md"} <= set(complaints(said)), said
    said = copy.release(out, "--key", "nobody@example.org", code=1)
    assert complaints(said) == ["--key"], said
    out.mkdir()
    (out / "mine").write_text("")
    said = copy.release(out, code=1)
    assert complaints(said) == [str(out)] and (out / "mine").exists(), said
    shutil.rmtree(out)
    say("another version, a key that is not there, a folder of somebody else: named")


def package_of_another_commit(copy, out):
    """`deploy/package` by itself takes neither program of another commit."""
    for wrong, installed in zip(PROGRAMS, ("descry", "descry-worker")):
        copy.reset()
        before = (copy.programs / wrong).read_bytes()
        copy.commit()
        (copy.programs / wrong).write_bytes(before)
        (out / "programs").mkdir(parents=True)
        for name, other in zip(PROGRAMS, ("descry", "descry-worker")):
            shutil.copy(copy.programs / name, out / "programs" / other)
        said = run(copy.folder / "deploy/package", "pack", out, "--local", code=1)
        assert f"programs/{installed}: must be {copy.version} of commit {copy.head()[:9]}" in said, said
        assert sorted(path.name for path in out.iterdir()) == ["programs"], list(out.iterdir())
        # Nor does it take for a package what runs on this machine alone.
        said = run(copy.folder / "deploy/package", "pack", out, code=1)
        assert "must need glibc" in said, said
        shutil.rmtree(out)
    say("deploy/package: either program of another commit, and programs of this machine: refused")


def time_in_the_package(copy, out):
    """A package that has the time in it differs from the next one: the file and what is in it are named."""
    copy.reset()
    copy.replace("deploy/package", 'put(root / "DEBIAN/control", control.encode(), False)',
                 'put(root / "DEBIAN/control", f"{control}Build: {__import__(\'time\').time_ns()}\\n".encode(), False)')
    copy.commit()
    said = copy.release(out, code=1)
    assert re.search(rf"^descry_{copy.version}_amd64\.deb: two builds must be equal, got a difference at \./control, byte \d+$",
                     said, re.MULTILINE), said
    assert said.count("two builds must be equal") == 1 and not out.exists(), said
    say("a time in the Debian package: found, and named")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("programs", metavar="PROGRAMS", type=pathlib.Path)
    parser.add_argument("out", metavar="OUT_DIR", type=pathlib.Path)
    options = parser.parse_args()
    folder = options.out.resolve() / "release"
    copy = Copy(folder, options.programs.resolve())
    with key():
        said = copy.release(folder / "out", "--key", KEY)
        say(said)
        assert "a dry run" in said and "not checked: whether the tests pass" in said, said
        contents(copy, folder / "out")
        verified(folder / "out")
    faults(copy, folder / "faulty")
    package_of_another_commit(copy, folder / "package")
    time_in_the_package(copy, folder / "differing")
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
