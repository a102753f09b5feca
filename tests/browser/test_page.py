"""The page of `elo report` in a browser without a network."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SECTIONS = ["summary", "distributions", "tables", "curves", "options", "scores", "engines", "replay", "config"]
LOCAL = ("file:", "blob:", "data:")
# A page opens in a second or so; a loaded machine may take much longer.
OPENS_WITHIN = 30.0
MOVES_WITHIN = 60.0


class Open:
    """A page that is open, and what it asked for and complained about."""

    def __init__(self, browser: Any, path: Path, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.context.set_offline(True)
        self.page = self.context.new_page()
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._console)
        started = time.monotonic()
        self.page.goto(path.as_uri())
        self.seconds = time.monotonic() - started

    def _console(self, message: Any) -> None:
        if message.type == "error":
            self.complaints.append(message.text)

    def player(self) -> Any:
        """The replay, once its clock shows that it is there."""
        replay = self.page.locator(".replay").first
        replay.scroll_into_view_if_needed()
        self.wait("document.querySelector('.replay .clock').value.includes('of')")
        return replay

    def clock(self) -> float:
        return float(self.page.locator(".replay .clock").first.inner_text().split()[0])

    def wait_for_clock(self, seconds: float) -> None:
        self.wait(f"parseFloat(document.querySelector('.replay .clock').value) >= {seconds}")

    def wait_for_complaint(self) -> None:
        deadline = time.monotonic() + MOVES_WITHIN
        while not self.complaints and time.monotonic() < deadline:
            self.page.wait_for_timeout(50)

    def wait(self, condition: str) -> None:
        """Until a condition holds. Playwright's own way to wait needs `eval`, which the page's policy forbids."""
        deadline = time.monotonic() + MOVES_WITHIN
        while not self.page.evaluate(condition):
            assert time.monotonic() < deadline, f"{condition}; {self.complaints}"
            self.page.wait_for_timeout(100)


@pytest.fixture
def opened(browser: Any, page_file: Path) -> Iterator[Open]:
    opened = Open(browser, page_file, viewport={"width": 1280, "height": 800})
    yield opened
    opened.context.close()
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(LOCAL)] == []


def test_the_page_opens_offline_and_has_every_section(opened: Open) -> None:
    assert opened.seconds < OPENS_WITHIN
    for section in SECTIONS:
        assert opened.page.locator(f"[data-section={section}] h2").is_visible(), section
    for plot in opened.page.locator("figure.plot svg").all():
        assert plot.locator("title").text_content()
        assert plot.locator("desc").text_content()
    links = opened.page.locator("nav a").all()
    assert len(links) == len(SECTIONS)


def test_no_policy_lets_the_page_load_anything(opened: Open) -> None:
    policy = opened.page.locator("meta[http-equiv=Content-Security-Policy]").get_attribute("content")
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy
    assert opened.page.evaluate("fetch('https://example.org/').then(() => 'loaded', () => 'refused')") == "refused"
    # The refusal is also logged, a moment later.
    opened.wait_for_complaint()
    opened.complaints.clear()
    opened.requests[:] = [url for url in opened.requests if "example.org" not in url]


def test_a_replay_plays_and_the_robot_moves(opened: Open) -> None:
    replay = opened.player()
    canvas = replay.locator("canvas")
    before = canvas.screenshot()
    replay.locator(".toggle").click()
    opened.wait_for_clock(2.0)
    replay.locator(".toggle").click()
    assert canvas.screenshot() != before
    assert "m forward" in replay.locator(".captions").inner_text()
    assert replay.locator(".captions p").count() == 2, "two engines stand side by side"
    assert replay.locator(".error").is_hidden()


def test_an_options_button_plays_it(opened: Open) -> None:
    button = opened.page.locator("button[data-play]").last
    button.click()
    opened.wait_for_clock(0.1)
    assert opened.page.locator(".replay .who").input_value() == button.get_attribute("data-play")


def test_the_replay_obeys_the_keyboard(opened: Open) -> None:
    replay, keyboard = opened.player(), opened.page.keyboard
    replay.locator(".stage").focus()
    keyboard.press("End")
    end = opened.clock()
    keyboard.press("Home")
    assert opened.clock() == 0.0
    keyboard.press("ArrowRight")
    step = opened.clock()
    keyboard.press("Shift+ArrowRight")
    assert 0.0 < step < opened.clock() < end
    keyboard.press("ArrowLeft")
    canvas = replay.locator("canvas")
    before = canvas.screenshot()
    replay.get_by_role("button", name="Turn left").press("Enter")
    assert canvas.screenshot() != before


def test_tab_reaches_every_control(opened: Open) -> None:
    opened.player()
    opened.page.evaluate("scrollTo(0, 0); document.activeElement.blur()")
    reached, names = set(), "a, button, select, input, summary, [tabindex='0']"
    wanted = opened.page.evaluate(
        "(names) => { const all = [...document.querySelectorAll(names)].filter((element) => element.checkVisibility());"
        " all.forEach((element, index) => { element.dataset.stop = index; }); return all.length; }",
        names,
    )
    for _ in range(wanted + 20):
        opened.page.keyboard.press("Tab")
        stop = opened.page.evaluate("document.activeElement?.dataset.stop ?? null")
        if stop is not None:
            reached.add(int(stop))
    missed = opened.page.evaluate(
        "(reached) => [...document.querySelectorAll('[data-stop]')]"
        ".filter((element) => !reached.includes(Number(element.dataset.stop))).map((element) => element.outerHTML.slice(0, 90))",
        sorted(reached),
    )
    assert missed == []


def test_the_skip_link_comes_first_and_is_seen(opened: Open) -> None:
    opened.page.keyboard.press("Tab")
    skip = opened.page.locator(".skip")
    assert skip.evaluate("(link) => link === document.activeElement && link.getBoundingClientRect().left >= 0")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1440, 390])
def test_it_is_readable_in(browser: Any, page_file: Path, tmp_path: Path, scheme: str, width: int) -> None:
    opened = Open(browser, page_file, viewport={"width": width, "height": 900}, color_scheme=scheme)
    shot = tmp_path / f"{scheme}-{width}.png"
    opened.page.screenshot(path=shot, full_page=True)
    assert shot.stat().st_size > 50_000
    dark = opened.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 22, 22)"
    assert dark == (scheme == "dark")
    wider = opened.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert wider <= 0, "the page itself never scrolls sideways"
    opened.context.close()


def _at(files: dict[str, Any], place: str) -> Any:
    name, pointer = place.split("#")
    found = files[name]
    for step in pointer.strip("/").split("/"):
        found = found[int(step) if isinstance(found, list) else step]
    return found


def test_every_figure_is_the_one_in_the_files(opened: Open, files: dict[str, Any]) -> None:
    cells = opened.page.evaluate(
        "[...document.querySelectorAll('[data-at]')].map((cell) => ({ ...cell.dataset, text: cell.textContent }))"
    )
    assert len(cells) > 300
    for cell in cells:
        found, text = _at(files, cell["at"]), cell["text"]
        digits = len(text.split(" ")[0].partition(".")[2])
        if not isinstance(found, dict):
            assert float(cell["value"]) == found, cell
            shown = f"{found * 100:.{digits}f} %" if "percent" in cell else f"{found:.{digits}f}"
        else:
            figures = [found["estimate"], found["low"], found["high"]]
            assert [float(cell[name]) for name in ("value", "low", "high")] == figures, cell
            scale, unit = (100, " %") if "percent" in cell else (1, "")
            estimate, low, high = (f"{figure * scale:.{digits}f}" for figure in figures)
            shown = f"{estimate}{unit} [{low}, {high}]"
        assert text == shown, cell


def test_what_is_absent_is_named(browser: Any, elo_program: Path, bare_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "bare.html"
    command = [elo_program, "report", bare_folder, "--out", out, "--replays", "0"]
    subprocess.run(command, check=True, capture_output=True)
    opened = Open(browser, out)
    for section in ("distributions", "curves", "engines", "replay"):
        assert opened.page.locator(f"[data-section={section}] .absent code").count() > 0, section
    assert opened.complaints == []
    opened.context.close()


def test_runs_are_switched(browser: Any, elo_program: Path, run_folder: Path, bare_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "two.html"
    subprocess.run([elo_program, "report", run_folder, bare_folder, "--out", out], check=True, capture_output=True)
    opened = Open(browser, out)
    first, second = (opened.page.locator(f"#run-{number}") for number in (1, 2))
    assert first.is_visible() and second.is_hidden()
    opened.page.locator(".switch button").nth(1).click()
    assert first.is_hidden() and second.is_visible()
    opened.page.locator(".switch button").last.click()
    assert first.is_visible() and second.is_visible()
    assert opened.complaints == []
    opened.context.close()


def test_plots_lie_beside_the_page(page_file: Path) -> None:
    folder = page_file.with_name("report-plots")
    names = {path.name for path in folder.iterdir()}
    for name in ("mean-return", "returns-density", "returns-cumulative", "curve-sampled", "scores-1"):
        assert {f"{name}.svg", f"{name}.csv"} <= names
    svg = (folder / "returns-density.svg").read_text()
    assert svg.startswith("<svg") and "var(--" not in svg
