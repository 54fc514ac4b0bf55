"""What the dashboard's server must refuse, and whom: the part of dashboard.py that asks without a browser."""

import http.client
import json
import urllib.parse

import dashboard_runs as runs

HIDDEN_WAYS = ["../quiet", "../../etc/passwd", "/etc/passwd", "quiet/../quiet", "..%2fquiet", "quiet\0", "./quiet"]


def expect(what, status, wanted):
    assert status in wanted, f"{what}: status {wanted} expected, got {status}"


def elsewhere(test):
    """Another host's name, another page, orders that no page has sent."""
    base = test.base
    own = base.rstrip("/")
    body = json.dumps({"id": "quiet", "action": "pause", "reason": "test"}).encode()
    expect("the page itself", runs.ask(base)[0], [200])
    for host in ["evil.example", "localhost.evil.example:1", "127.0.0.1:1", "192.0.2.1"]:
        expect(f"host {host}", runs.ask(f"{base}api/runs", Host=host)[0], [403])
    for origin in ["http://evil.example", "null", own + "0", "file://"]:
        expect(f"origin {origin}", runs.ask(f"{base}api/runs", Origin=origin)[0], [403])
        expect(f"order of {origin}", runs.ask(f"{base}api/control", body, Origin=origin)[0], [403])
    expect("an order of no page", runs.ask(f"{base}api/control", body)[0], [403])
    expect("fetched by another site", runs.ask(f"{base}api/runs", Sec_Fetch_Site="cross-site")[0], [403])
    expect("an order of its own page", runs.ask(f"{base}api/control", body, Origin=own)[0], [409])
    return "4 hosts and 4 pages of elsewhere refused, and an order without a page"


def paths(test):
    """Ways out of the folders on show."""
    asked = 0
    for way in HIDDEN_WAYS:
        quoted = urllib.parse.quote(way, safe="")
        for address in [
            f"api/run?id={quoted}",
            f"api/stream?id={quoted}",
            f"api/report?id={quoted}",
            f"api/cloud?id=quiet&path={quoted}",
            f"api/explain?id=quiet&query={quoted}&answer={quoted}",
            f"api/answers?id=quiet&of={quoted}",
            f"api/answers?id=quiet&of=compared:{quoted}",
            quoted,
        ]:
            expect(address, runs.ask(test.base + address)[0], [404])
            asked += 1
    return f"{asked} refused"


def too_much(test):
    """Bodies that are too long, or nothing; parameters out of any range."""
    own = test.base.rstrip("/")
    for path in ["api/control", "api/login"]:
        try:
            status, _ = runs.ask(test.base + path, b"x" * (1 << 20), Origin=own)
        except OSError:  # it has hung up before the end
            status = 413
        expect(f"1 MB to {path}", status, [400, 401, 413])
        expect(f"nothing to {path}", runs.ask(test.base + path, b"", Origin=own)[0], [400, 401])
    for address in ["api/stream?id=quiet&generation=-1", "api/cloud?id=quiet&path=a&points=1e9", "api/run"]:
        expect(address, runs.ask(test.base + address)[0], [400])
    expect("still there", runs.ask(f"{test.base}api/runs")[0], [200])
    return "1 MB and nothing are no orders, and it goes on"


def tokens(test):
    """Over TLS, whom the tokens let do what; the page asks for one."""
    folder = test.out / "tls"
    assert test.programs.start("certs", "certs", folder, "--host", "localhost").ended() == 0, "coordinator certs"
    served = test.programs.dashboard(test.out / "runs", "--tls", folder, listen="0.0.0.0:0", name="tls")
    base = f"https://localhost:{served.port()}/"
    own = base.rstrip("/")
    look, act = ((folder / f"dashboard-{name}").read_text().strip() for name in ("view", "control"))
    order = json.dumps({"id": "quiet", "action": "pause", "reason": "test"}).encode()
    every = ["runs", "run?id=quiet", "stream", "stream?id=quiet", "answers?id=quiet&of=test", "clouds?id=quiet",
             "cloud?id=quiet&path=a", "explain?id=quiet&query=a&answer=b", "landscape?id=quiet&a=w&b=w",
             "report?id=quiet", "nothing"]  # fmt: skip
    for path in every:
        for token in ["", "Bearer ", f"Bearer {look[:-1]}", f"Basic {look}", f"Bearer {'A' * len(look)}"]:
            headers = {"Authorization": token} if token else {}
            expect(f"{path} with {token[:7]!r}", runs.ask(f"{base}api/{path}", **headers)[0], [401])
    control = f"{base}api/control"
    expect("the page", runs.ask(base)[0], [200])
    expect("to look", runs.ask(f"{base}api/runs", Authorization=f"Bearer {look}")[0], [200])
    said = json.loads(runs.ask(f"{base}api/runs", Authorization=f"Bearer {look}")[1])
    assert said["may_control"] is False, "who may look is told that he may act"
    expect("to act with none", runs.ask(control, order, Origin=own)[0], [401])
    expect("to act with that to look", runs.ask(control, order, Origin=own, Authorization=f"Bearer {look}")[0], [401])
    # A finished run has no coordinator: it conflicts, but is allowed.
    expect("to act", runs.ask(control, order, Origin=own, Authorization=f"Bearer {act}")[0], [409])
    expect("a wrong login", runs.ask(f"{base}api/login", b'{"token":"x"}', Origin=own)[0], [401])
    expect("plain HTTP", _plain(served.port()), [None, 400])
    page = test.page(ignore_https_errors=True)
    page.goto(base)
    page.locator("input[name=token]").fill("wrong")
    page.get_by_role("button", name="Log in").click()
    page.get_by_text("This token is not known").wait_for()
    page.locator("input[name=token]").fill(look)
    page.get_by_role("button", name="Log in").click()
    page.get_by_role("link", name="quiet", exact=True).wait_for()
    page.context.close()
    served.kill()
    return f"{len(every)} addresses closed without a token; one looks, the other acts; the page logs in"


def _plain(port):
    try:
        return runs.ask(f"http://127.0.0.1:{port}/")[0]
    except (OSError, http.client.HTTPException):
        return None  # it has hung up


CHECKS = [("elsewhere", elsewhere), ("paths", paths), ("too much", too_much), ("tokens", tokens)]
