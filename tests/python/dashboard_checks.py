"""What a reader of the dashboard sees and does: the part of dashboard.py that needs a browser."""

import json
import shutil

import dashboard_runs as runs

VIEWS = ["overview", "convergence", "population", "answers", "descriptor", "fleet", "timeline", "log", "control"]
HOSTILE = "<img src=x onerror=alert(1)>"
NOT_BLANK = """canvases => canvases.every(canvas => {
    const copy = document.createElement('canvas');
    [copy.width, copy.height] = [canvas.width, canvas.height];
    const context = copy.getContext('2d');
    context.drawImage(canvas, 0, 0);
    const pixels = new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer);
    const colours = new Map();
    for (const pixel of pixels) colours.set(pixel, (colours.get(pixel) ?? 0) + 1);
    const most = Math.max(...colours.values());
    return colours.size > 20 && pixels.length - most > 500;
})"""


def until(page, expression):
    """Waits for an expression of the page; Playwright's own way needs eval, which the page forbids."""
    runs.wait(expression, lambda: page.evaluate(expression))


def figure(page, name):
    """A figure above the views, such as Generation."""
    return page.locator(".figures > div").filter(has=page.locator("dt", has_text=name)).locator("dd span").inner_text()


def ready(page):
    """Waits until a view has something to show."""
    page.locator("#content .panel").first.wait_for()
    until(page, "!document.querySelector('#content').innerText.match(/(Loading|Waiting for the .*) …/)")


def last_number(place):
    """The last number of a text, such as that of all rows under a table."""
    return int(place.inner_text().replace("\u202f", "").split()[-1])


def tab(page, title):
    page.locator(".tabs a", has_text=title).click()
    ready(page)


def order(page, button, reason):
    """Gives an order in the view of control."""
    page.locator(".commands").get_by_role("button", name=button, exact=True).click()
    confirm(page, reason)


def confirm(page, reason):
    page.locator("dialog input[name=reason]").fill(reason)
    page.locator("dialog form button.primary, dialog form button.danger").click()
    page.locator("dialog .done").wait_for()
    page.locator("dialog").get_by_role("button", name="Close").click()


def prepare(test):
    """A run that nobody watches, and its copies, for all other checks."""
    # Two workers: the fleet and the timeline have something to show.
    test.digest = test.programs.run("quiet", test.exp, "--local-workers", "2", cold=False).digest()
    finished = test.out / "runs/quiet"
    shutil.copytree(finished, test.out / "runs" / HOSTILE)
    serve(test)


def serve(test, listen="127.0.0.1:0"):
    test.served = test.programs.dashboard(test.out / "runs", listen=listen)
    test.base = test.served.address()


def live(test):
    """A run is watched to its end: paused and resumed on the way, its coordinator killed and back."""
    program = test.programs.run("watched", test.exp, "--local-workers", "2", "--dashboard", "127.0.0.1:0")
    address = program.address()
    # Held from outside until the page is open: the run may be over before a browser on a busy machine has drawn it.
    program.said(r"(generation 1/)")
    pause = ["control", test.out / "runs/watched", "pause", "--reason", "a test opens a browser"]
    assert test.programs.start("pause", *pause).ended() == 0, "the run cannot be paused from outside"
    page = test.page()
    page.goto(runs.address(address, "watched"))
    page.evaluate("window.notReloaded = true")
    page.locator(".badge.paused").wait_for()
    generation = lambda: int(figure(page, "Generation").split(" of ")[0])
    first = generation()
    tab(page, "Fleet")
    for button, then in [("Drain", "draining"), ("Give jobs", "idle")]:
        page.get_by_role("button", name=f"{button} local-2").click()
        confirm(page, "a test looks")
        page.locator("#content tbody tr", has_text="local-2").get_by_text(then).wait_for()
    tab(page, "Wrong answers")
    hidden = page.get_by_text("Test clouds are hidden until the search ends")
    hidden.wait_for()
    test_cloud = (test.out / "data/test.txt").read_text().split()[0]
    status, _ = runs.ask(f"{program.address()}api/cloud?id=watched&path={test_cloud}")
    assert status == 403, f"a test cloud of a run that goes on: status 403 expected, got {status}"
    listed = json.loads(runs.ask(f"{program.address()}api/clouds?id=watched")[1])["clouds"]
    assert listed and all(cloud["split"] != "test" for cloud in listed), "test clouds are listed before the end"
    assert program.process.poll() is None, "the run has ended although it is paused"
    tab(page, "Control")
    order(page, "Resume", "the test has looked")
    second = runs.wait("another generation", lambda: (now := generation()) > first and now)
    order(page, "Pause", "a test looks again")
    page.locator(".badge.paused").wait_for()
    program.kill()
    lost = page.locator("#banner.lost")
    lost.wait_for()
    back = ["resume", test.out / "runs/watched", "--listen", "127.0.0.1:0", "--no-cache", "--local-workers", "2"]
    program = test.programs.start("watched-again", *back, "--dashboard", address.split("/")[2])
    program.address()
    lost.wait_for(state="hidden")
    page.locator("#connection.open").wait_for()
    if page.locator(".badge.paused").count():
        order(page, "Resume", "the test has looked again")
    assert program.digest() == test.digest, "a run that was watched, paused, killed and resumed has another digest"
    lost.wait_for()
    assert "No connection to the coordinator since" in lost.inner_text(), lost.inner_text()
    assert page.evaluate("window.notReloaded"), "the page was loaded again"
    page.context.close()
    return f"paused at generation {first}, a worker drained and back, test clouds hidden, killed at {second} and back, the same digest, connection lost"


def every_view(test):
    """The views of a finished run and of the list of runs, without complaints."""
    page = test.page()
    page.goto(test.base)
    page.get_by_role("link", name="quiet", exact=True).wait_for()
    test.shot(page, "runs")
    for view in VIEWS:
        page.goto(runs.address(test.base, "quiet", view=view))
        ready(page)
        assert page.locator(".tabs [aria-current=page]").count() == 1, f"{view}: not the tab on show"
        assert page.locator("#content .panel").count() > 0, f"{view}: nothing on show"
        test.shot(page, view)
    problems(page)
    local(test, page)
    page.context.close()
    return f"{len(VIEWS)} views and the list"


def problems(page):
    assert not page.problems, f"the browser complains: {page.problems}"


def local(test, page):
    """No request has left the origin."""
    away = [url for url in page.requested if not url.startswith((test.base, "data:", "blob:"))]
    assert page.requested and not away, f"requests to elsewhere: {away}"


def looks(test, run):
    return json.loads(runs.ask(f"{test.base}api/run?id={run}")[1])["looks"]


def wrong_answers(test):
    """Three clouds, once the reader has agreed to look, which is recorded."""
    page = test.page()
    before = len(looks(test, "quiet"))
    page.goto(runs.address(test.base, "quiet", view="answers", of="test"))
    agree = page.get_by_role("button", name="Show test clouds and record it")
    agree.wait_for()
    assert not [url for url in page.requested if "/api/cloud?" in url], "clouds were fetched before the reader agreed"
    assert len(looks(test, "quiet")) == before, "a look is recorded before the reader agreed"
    agree.click()
    clouds = page.locator(".answer-detail canvas.cloud")
    runs.wait("three clouds with points", lambda: clouds.count() == 3 and clouds.evaluate_all(NOT_BLANK))
    page.locator(".triple .figures dd").first.wait_for()
    recorded = runs.wait("a look in the table", lambda: len(looks(test, "quiet")) > before and looks(test, "quiet"))
    assert recorded[-1]["command"] == "dashboard", f"who looked: dashboard expected, got {recorded[-1]['command']}"
    title = page.locator(".answer-title")
    first = title.inner_text()
    page.keyboard.press("j")
    until(page, "document.querySelector('.answer-detail .muted').textContent.startsWith('2 of')")
    runs.wait("the next three clouds", lambda: clouds.evaluate_all(NOT_BLANK))
    test.shot(page, "answers-3d")
    problems(page)
    local(test, page)
    page.context.close()
    return f"“{first}” and the next: three clouds each, and a look recorded"


def brush(test):
    """A range of one axis filters the views."""
    page = test.page()
    page.goto(runs.address(test.base, "quiet", view="fleet"))
    ready(page)
    workers = page.locator("#content tbody tr").count()
    tab(page, "Population")
    handle = page.locator("rect.handle[data-axis=object_error]")
    handle.wait_for()
    total = page.locator("#content .pager span").last.inner_text()
    # Not by Playwright, which fails if the chart is drawn again meanwhile.
    handle.evaluate("handle => handle.scrollIntoView({block: 'center'})")
    box = handle.bounding_box()
    middle, foot = box["x"] + box["width"] / 2, box["y"] + box["height"] - 8
    page.mouse.move(middle, foot)
    page.mouse.down()
    page.mouse.move(middle, foot - box["height"] * 0.3, steps=4)
    page.mouse.up()
    chip = page.locator(".brush-chip")
    chip.wait_for()
    shown = chip.inner_text().replace("\u202f", "").split(" individuals")[0]
    passing, of = [int(word) for word in shown.split()[-3::2]]
    assert 0 < passing < of, f"a brush of a part lets some pass, got {passing} of {of}"
    rows = page.locator("#content .pager span").last
    runs.wait(f"fewer rows than {total}", lambda: rows.inner_text().replace("\u202f", "").endswith(f" of {passing}"))
    tab(page, "Convergence")
    page.get_by_text("best of the brushed").first.wait_for()
    tab(page, "Timeline")
    attempts = page.locator("#content .pager span").last
    runs.wait("fewer attempts", lambda: 0 < last_number(attempts) <= passing)
    tab(page, "Fleet")
    column = page.locator("#content thead th").all_inner_texts().index("Brushed")
    cells = page.locator(f"#content tbody tr > :nth-child({column + 1})").all_inner_texts()
    by_workers = sum(int(cell.replace("\u202f", "")) for cell in cells)
    assert 0 < by_workers <= passing, f"individuals of the brush by worker: at most {passing} expected, got {by_workers}"
    page.get_by_role("button", name="Clear the brush").click()
    chip.wait_for(state="hidden")
    assert page.locator("#content tbody tr").count() == workers, "workers are missing after the brush is cleared"
    tab(page, "Population")
    runs.wait("all individuals again", lambda: page.locator("#content .pager span").last.inner_text() == total)
    problems(page)
    page.context.close()
    return f"{passing} of {of} pass, {by_workers} of them computed by {len(cells)} workers, then all again"


def back_again(test):
    """The dashboard is killed and started again at its port: the page says so and goes on by itself."""
    page = test.page()
    page.goto(runs.address(test.base, "quiet", view="convergence"))
    ready(page)
    test.served.kill()
    page.locator("#banner.lost").wait_for()
    assert page.locator("#connection").inner_text() == "connection lost", page.locator("#connection").inner_text()
    assert page.locator("#content .panel").count() > 0, "what was on show has gone with the connection"
    serve(test, test.base.split("/")[2])
    page.locator("#banner").wait_for(state="hidden")
    page.locator("#connection.open").wait_for()
    page.context.close()
    return "a banner, and gone again"


def hostile_data(test):
    """The clouds of the demo, whose objects have a hostile name."""
    source, place = test.out / "data", test.out / "hostile"
    renamed = lambda path: "/".join(
        [(parts := path.split("/"))[0], parts[1] + HOSTILE, parts[2].replace(parts[1], parts[1] + HOSTILE)]
    )
    for cloud in source.glob("*/*/*.pcd"):
        target = place / renamed(str(cloud.relative_to(source)))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(cloud, target)
    for names in source.glob("*.txt"):
        (place / names.name).write_text("".join(f"{renamed(line)}\n" for line in names.read_text().splitlines()))
    text = runs.experiment(test.out, place, population=4, generations=2)
    start, end = (text.read_text().index(section) for section in ("[dataset.synthetic]", "[preprocess]"))
    text.write_text(text.read_text()[:start] + text.read_text()[end:])
    return text


def names(test):
    """Names of runs and objects that look like markup stay text."""
    test.programs.run("objects", hostile_data(test), cold=False).digest()
    page = test.page()
    page.goto(test.base)
    page.get_by_role("link", name=HOSTILE, exact=True).click()
    page.locator("h1", has_text=HOSTILE).wait_for()
    for run, views in [(HOSTILE, ["overview", "control"]), ("objects", VIEWS)]:
        for view in views:
            page.goto(runs.address(test.base, run, view=view))
            ready(page)
            assert page.locator("img, [onerror]").count() == 0, f"{view} of {run}: a name became markup"
    page.goto(runs.address(test.base, "objects", view="answers", of="test"))
    page.get_by_role("button", name="Show test clouds").click()
    page.locator(".triple .figures dd").first.wait_for()
    assert HOSTILE in page.locator(".answer-title").inner_text(), "the object has lost its name"
    assert page.locator("img, [onerror]").count() == 0, "a name became markup"
    status, report = runs.ask(f"{test.base}api/report?id=objects")
    assert status == 200 and HOSTILE.encode() not in report, "a name became markup in the report"
    problems(page)
    local(test, page)
    page.context.close()
    return f"of a run and of objects, in {len(VIEWS)} views and the report"


def overflow(page):
    return page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")


def screens(test):
    """Narrow and wide, dark and light: nothing is wider than the screen, except inside its box."""
    seen = 0
    for width, height in [(390, 844), (3840, 2160)]:
        for scheme in ["light", "dark"]:
            page = test.page(viewport={"width": width, "height": height}, color_scheme=scheme)
            for view in ["runs", *VIEWS]:
                values = {} if view == "runs" else {"run": "quiet", "view": view}
                page.goto(runs.address(test.base, **values))
                ready(page)
                if view == "runs":
                    page.get_by_role("link", name="quiet", exact=True).wait_for()
                wide = overflow(page)
                assert wide <= 0, f"{view} at {width} px, {scheme}: {wide} px too wide"
                test.shot(page, f"{view}-{width}-{scheme}")
                seen += 1
            problems(page)
            background = page.evaluate("getComputedStyle(document.body).backgroundColor")
            brightness = sum(int(part) for part in background[4:-1].split(",")[:3])
            assert (brightness < 200) == (scheme == "dark"), f"{scheme}: background {background}"
            page.context.close()
    return f"{seen} pages"


def keyboard(test):
    """From the list of runs to every tab and to the numbers of a wrong answer, by keys alone."""
    page = test.page()
    page.goto(test.base)
    page.get_by_role("link", name="quiet", exact=True).wait_for()
    pressed = 0

    def to(wanted):
        """Tabs until the focus is where the script says."""
        nonlocal pressed
        for _ in range(150):
            page.keyboard.press("Tab")
            pressed += 1
            if page.evaluate(f"(element => {wanted})(document.activeElement)"):
                shown = page.evaluate(
                    "(style => style.outlineStyle !== 'none' || style.boxShadow !== 'none')"
                    "(getComputedStyle(document.activeElement))"
                )
                assert shown, f"the focus cannot be seen on {wanted}"
                return
        raise AssertionError(f"not reached by 150 tabs: {wanted}")

    to("element.textContent === 'quiet' && element.tagName === 'A'")
    page.keyboard.press("Enter")
    page.locator(".tabs").wait_for()
    for title in page.locator(".tabs a").all_inner_texts():
        page.evaluate("document.activeElement.blur()")
        to(f"element.closest('.tabs') && element.textContent === {json.dumps(title)}")
        page.keyboard.press("Enter")
        runs.wait(f"the tab {title}", lambda: f" – {title} – " in page.title())
        ready(page)
    page.evaluate("document.activeElement.blur()")
    to("element.closest('.tabs') && element.textContent === 'Wrong answers'")
    page.keyboard.press("Enter")
    page.locator(".wrong-list, .answers-side button.link").first.wait_for()
    to("element.matches('button.link') && element.closest('.answers-side')")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    until(page, "document.activeElement.matches('.answer-title')")
    numbers = page.locator(".triple .figures")
    runs.wait("the numbers of the wrong answer", lambda: numbers.inner_text().strip())
    problems(page)
    page.context.close()
    return f"9 tabs and the numbers of a wrong answer, {pressed} times Tab"


def tabs(test):
    """More tabs than a browser has connections to a host: those that nobody sees leave theirs to the others."""
    context = test.page().context
    context.add_init_script("Object.defineProperty(document, 'hidden', {get: () => window.isHidden ?? false})")
    hide = """is => {
        window.isHidden = is;
        document.dispatchEvent(new Event('visibilitychange'));
    }"""
    opened = []
    for _ in range(9):
        page = context.new_page()
        if test.page_folder:
            page.route("**/*.js", test.from_folder)
        page.goto(runs.address(test.base, "quiet", view="overview"))
        page.locator("#content .verdict").first.wait_for()
        page.evaluate(hide, True)
        opened.append(page)
    first = opened[0]
    first.evaluate("document.querySelector('#connection').textContent = 'rests'")
    first.evaluate(hide, False)
    until(first, "document.querySelector('#connection').textContent === 'connected'")
    tab(first, "Population")
    first.locator("#content tbody td").first.wait_for()
    context.close()
    return f"{len(opened)} tabs, the first goes on when it is seen again"


def lineage(test):
    """What a child has of neither parent: of genes in no slot, and of slots that have changed places."""
    page = test.page()
    page.goto(runs.address(test.base, "quiet", view="population"))
    ready(page)
    # Genes of two parents and of their child.
    families = [
        [{"R1": 1, "m": 4}, {"R1": 2, "m": 4}, {"R1": 3, "m": 4}],
        *[
            [dict(zip(("s1_d", "s1_R", "s2_d", "s2_R"), values)) for values in ([1, 2, 3, 4], [5, 6, 7, 8], child)]
            for child in ([7, 8, 3, 9], [3, 4, 7, 8], [1, 6, 7, 4])
        ],
    ]
    said = page.evaluate(
        """async (families) => {
          const { novelty } = await import('/lineage.js');
          return families.map((family) => {
            const genes = Object.keys(family[0]);
            const columns = Object.fromEntries(genes.map((gene) => [gene, family.map((one) => one[gene])]));
            Object.assign(columns, { generation: [1, 1, 2], parent_a: [null, null, 0], parent_b: [null, null, 1] });
            const rowOf = (generation, individual) => (generation === 1 ? individual : undefined);
            return novelty({ individuals: { columns }, rowOf }, genes, 2);
          });
        }""",
        families,
    )
    wanted = ["new: R1 3", "new: s2_R 9", "all genes of its parents", "all genes of its parents"]
    assert said == wanted, f"what is new: {wanted} expected, got {said}"
    problems(page)
    page.context.close()
    return "genes and slots"


CHECKS = [
    ("prepare", prepare),
    ("live", live),
    ("views", every_view),
    ("wrong answers", wrong_answers),
    ("brush", brush),
    ("lineage", lineage),
    ("back again", back_again),
    ("names", names),
]
MORE = [("screens", screens), ("keyboard", keyboard), ("tabs", tabs)]
