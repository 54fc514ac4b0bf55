"""Tests the dashboard in a browser, and its server by requests that no browser would send.

Usage: dashboard.py COORDINATOR OUT_DIR [--gate | --all] [--only NAMES] [--shots DIR] [--page DIR]

Needs playwright (PyPI) and Chromium. Makes its own runs in OUT_DIR, which is emptied first. --gate tests only what must
pass before a change lands, in a shorter run; --all also tests narrow and wide screens, keyboards, crowds of viewers and a
dashboard that is killed; --page takes the page from a folder instead of from the program, to try a change of it without a
build. Says what it has checked, a line each; exit code 1 if something is not as it should be.
"""

import argparse
import pathlib
import sys
import time
import traceback

import dashboard_checks as checks
import dashboard_crowds as crowds
import dashboard_requests as requests
import dashboard_runs as runs

HERE = pathlib.Path(__file__).parent
GATE = ["live", "wrong answers", "brush", "lineage", "back again", "elsewhere", "tokens"]


class Test:
    """What the checks share."""

    def __init__(self, options):
        self.out = runs.fresh(options.out)
        self.shots, self.page_folder = options.shots, options.page
        self.programs = runs.Programs(pathlib.Path(options.coordinator).resolve(), self.out)
        self.browser = None
        self.failed = []
        self.exp = runs.experiment(self.out, self.out / "data", population=40, generations=24 if options.gate else 60)
        self.digest = None  # of the run that nobody has watched
        self.base = None  # the address of a dashboard of all finished runs
        self.served = None  # its program

    def check(self, name, what):
        """Does a check, which says what it has seen."""
        begun = time.monotonic()
        try:
            seen = what(self)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            ours = [frame for frame in frames if pathlib.Path(frame.filename).parent == HERE]
            where = next((frame for frame in reversed(ours) if frame.name != "<lambda>"), ours[-1])
            self.failed.append(name)
            print(f"FAILED {name}: {error} ({pathlib.Path(where.filename).name}:{where.lineno})", flush=True)
        else:
            print(f"{name}: {seen} ({time.monotonic() - begun:.1f} s)", flush=True)

    def page(self, **options):
        """A page in a context of its own, with what it has complained of as `problems`, asked for as `requested`."""
        options = {"viewport": {"width": 1440, "height": 900}, "color_scheme": "light", **options}
        page = self.browser.new_context(**options).new_page()
        page.set_default_timeout(runs.PATIENCE * 1000)
        page.problems, page.requested = [], []
        page.on("console", lambda said: said.type in ("error", "warning") and page.problems.append(said.text))
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.on("dialog", lambda dialog: (page.problems.append(f"dialog {dialog.message}"), dialog.dismiss()))
        page.on("request", lambda request: page.requested.append(request.url))
        if self.page_folder:
            page.route("**/*.js", self.from_folder)
            page.route("**/*.css", self.from_folder)
        return page

    def from_folder(self, route):
        name = route.request.url.split("?")[0].rsplit("/", 1)[1]
        path = pathlib.Path(self.page_folder) / name
        route.fulfill(path=path) if path.exists() else route.continue_()

    def shot(self, page, name):
        if self.shots:
            pathlib.Path(self.shots).mkdir(parents=True, exist_ok=True)
            page.screenshot(path=f"{self.shots}/{name}.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("coordinator")
    parser.add_argument("out")
    parser.add_argument("--gate", action="store_true")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--only", help="names of checks, for example brush,names")
    parser.add_argument("--shots")
    parser.add_argument("--page")
    options = parser.parse_args()
    test = Test(options)
    try:
        with runs.browser() as test.browser:
            checks.CHECKS[0][1](test)
            only = options.only.split(",") if options.only else GATE if options.gate else None
            for name, what in [*checks.CHECKS[1:], *requests.CHECKS, *((checks.MORE + crowds.CHECKS) * options.all)]:
                if only is None or name in only:
                    test.check(name, what)
    finally:
        test.programs.close()
    sys.exit(1 if test.failed else 0)


if __name__ == "__main__":
    main()
