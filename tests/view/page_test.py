#!/usr/bin/python3
"""Clicks through pages of `porttape view` as a user does. Arguments: the program, a folder for pages and screenshots."""

import pathlib
import subprocess
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import browser  # noqa: E402
import tapes  # noqa: E402

EXCHANGES = 300


def expect(is_true, what):
    if not is_true: raise AssertionError(what)


def same(got, wanted):
    expect(got == wanted, f"{got!r}, not {wanted!r}")


def selects(page, words):
    """Waits until the selected row of the tape's list has these words: rows are drawn with the next frame."""
    page.shows(".pane.active .row.selected", words)


def places(page):
    """Each place at the left is shown, and the exchange at fault is there, by click and by key."""
    items = [item.text for item in page.driver.find_elements("css selector", ".side .item")]
    for number, words in enumerate(("begins with 45, usually 6f", "no answer for 80", "× the median", "512 bytes missing", "first after the gap")):
        expect(words in items[number], f"place {number} is {items[number]!r}")
    page.find(".side .item").click()
    selects(page, "Error:checksum")
    page.shows(".detail .remark", "begins with 45")
    page.shows(".dump", "Error:ch")
    page.keys(".")
    selects(page, "no answer")
    page.keys(",")
    selects(page, "Error:checksum")


def addresses(page, path):
    """Every selection has an address, back and forward go through them, a link leads there."""
    page.find(".side .item:nth-child(3)").click()
    slow = page.js("location.hash")
    expect(slow.startswith("#t="), slow)
    title = page.text(".detail h2")
    page.find(".side .item:nth-child(1)").click()
    odd = page.js("location.hash")
    page.driver.back()
    page.until("location.hash === arguments[0] && document.querySelector('.detail h2').textContent === arguments[1]", slow, title)
    page.driver.forward()
    page.until(f"location.hash === '{odd}' && document.querySelector('.dump').textContent.includes('Error')")
    page.open(path, odd)
    selects(page, "Error:checksum")
    page.open(path, "#t=nonsense&event=99999")
    page.open(path, "#t=1e99")
    page.until("porttape.active.selection !== null")  # the last thing, for a time behind the end


def searches(page):
    """Text across blocks, hex, expressions, hit by hit; what is wrong is told."""
    page.find("body").click()
    page.keys("/")
    page.keys("firmware 2.1.3\n")
    page.until("document.getElementById('search-state').textContent.includes(' of ')")
    count = page.text("#search-state").split(" of ")[1]
    wanted = sum(1 for number in range(0, EXCHANGES, 3) if number % 7 == 3)
    same(count, str(wanted))
    first = page.js("location.hash")
    page.keys("\n")
    page.until(f"location.hash !== '{first}'")
    page.until("document.querySelectorAll('.dump .hit').length >= 26")
    page.until("document.querySelectorAll('.pane mark').length > 0")
    page.find("#search-back").click()
    page.until(f"location.hash === '{first}'")
    for kind, text, state in (("hex", "4d 31 ?? 35 0a", f"{EXCHANGES // 3} hits"), ("regex", r"^RUN=1\d\d|RUN=1\d\d\r", "32 hits"),
                              ("text", "not there", "no hit")):
        page.js("void(document.getElementById('search-kind').value = arguments[0], document.getElementById('search-text').value = '')", kind)
        page.find("#search-text").send_keys(text)
        page.until("document.getElementById('search-state').textContent === arguments[0]", state)
    for kind, text in (("hex", "4d 3"), ("regex", "(")):
        page.js("void(document.getElementById('search-kind').value = arguments[0], document.getElementById('search-text').value = '')", kind)
        page.find("#search-text").send_keys(text)
        page.until("document.getElementById('search-text').getAttribute('aria-invalid') === 'true' && document.getElementById('search-state').textContent")
    page.find("#search-text").clear()
    page.find("#search-text").send_keys(browser_keys().ESCAPE)


def browser_keys():
    from selenium.webdriver.common.keys import Keys
    return Keys


def keyboard(page):
    """Rows, exchanges, views, zoom, help: all without a mouse."""
    keys = browser_keys()
    page.keys(keys.HOME)
    selects(page, "open")
    page.keys(keys.ARROW_DOWN)
    selects(page, "M115")
    page.keys("]")
    selects(page, "#2")
    page.keys("[")
    selects(page, "#1")
    page.keys("3")
    page.shows("#views [aria-checked=true]", "Blocks")
    page.keys(keys.END)
    selects(page, "close")
    page.keys("1")
    span = "porttape.range.to - porttape.range.from"
    whole = page.js(span)
    page.keys("+")
    page.until(f"{span} < arguments[0] * 0.6", whole)
    page.keys("0")
    page.until(f"Math.abs({span} - arguments[0]) < 1", whole)
    page.keys("g")
    page.keys("0.5\n")
    page.until("Math.abs(parseFloat(location.hash.slice(3)) - 0.5) < 0.1")
    page.keys(keys.ESCAPE)
    page.keys("z")
    page.until(f"{span} < arguments[0] / 10", whole)
    page.keys("?")
    page.until("document.getElementById('help').open")
    page.keys(keys.ESCAPE)
    page.until("!document.getElementById('help').open")


def timeline(page):
    """The wheel zooms, a drag moves, a click selects, the strip takes a range."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
    slider, strip = page.find(".slider"), page.find(".strip")
    page.js("porttape.range.whole()")
    span = page.js("porttape.range.to - porttape.range.from")
    ActionChains(page.driver).scroll_from_origin(ScrollOrigin.from_element(slider), 0, -300).perform()
    page.until("porttape.range.to - porttape.range.from < arguments[0]", span)
    before = page.js("porttape.range.from")
    ActionChains(page.driver).drag_and_drop_by_offset(slider, -200, 0).perform()
    page.until("porttape.range.from > arguments[0]", before)
    ActionChains(page.driver).drag_and_drop_by_offset(strip, 150, 0).perform()
    page.until("porttape.range.to - porttape.range.from < arguments[0] / 5", span)
    address = page.js("location.hash")
    ActionChains(page.driver).move_to_element_with_offset(strip, -400, 0).click().perform()
    page.until("location.hash !== arguments[0]", address)


def colours(page):
    """The system's, and by the button the others."""
    ground = "getComputedStyle(document.body).backgroundColor"
    same(page.js(ground), "rgb(255, 255, 255)")
    page.find("#theme").click()
    page.until("document.documentElement.dataset.theme === 'light'")
    page.find("#theme").click()
    page.until(f"{ground} === 'rgb(13, 17, 23)'")
    page.find("#theme").click()


def hostile(page):
    """Nothing of a tape has become markup, nothing was loaded, nothing complained."""
    same(page.js("document.querySelectorAll('main img, main script').length"), 0)
    expect("owned" not in page.js("document.title"), "the title")
    page.find("#tab-events").click()
    page.until("document.querySelector('.side .row')")
    page.shows(".side-panel", "<img src=x")  # the text of a mark as it is
    page.shows(".side-panel", "\\u202e")  # what turns text is escaped
    same(page.js("performance.getEntriesByType('resource').length"), 0)


def two_tapes(page):
    """Differences lead to both tapes; an exchange leads to its own in the other."""
    expect(page.text("#side-tabs [aria-selected=true]").startswith("Differences"), "the first tab")
    items = page.driver.find_elements("css selector", ".side .item")
    expect(any("changed" in item.text for item in items) and any("missing" in item.text for item in items), [item.text for item in items])
    next(item for item in items if "changed" in item.text).click()
    page.until("porttape.panes.every(pane => pane.selection)")
    page.until("document.querySelectorAll('.dump .differs').length > 0")
    page.js("porttape.select(porttape.panes[0], {block: porttape.panes[0].exchanges.start[250]})")
    same(page.js("porttape.comparison.partner(0, 250)"), 249)
    same(page.js("porttape.panes[1].exchanges.of(porttape.panes[1].selection.block)"), 249)
    page.keys("x")
    expect("tape" not in page.js("location.hash"), "only a selection has an address")


def main(program, folder):
    lacks = browser.missing()
    if lacks:
        print(f"skipped: no {lacks}", file=sys.stderr)
        return 77
    folder = pathlib.Path(folder)
    tapes.printer(folder / "good", EXCHANGES)
    tapes.printer(folder / "bad", EXCHANGES, is_bad=True)
    one, two = folder / "one.html", folder / "two.html"
    subprocess.run([program, "view", folder / "bad", "-o", one], check=True)
    subprocess.run([program, "view", folder / "good", folder / "bad", "-o", two], check=True)
    with browser.Browser(late_ms=100) as page:
        page.open(one)
        try:
            places(page)
            page.shot(folder / "places.png")
            addresses(page, one)
            searches(page)
            keyboard(page)
            page.shot(folder / "zoomed.png")
            timeline(page)
            colours(page)
            hostile(page)
            page.open(two)
            two_tapes(page)
            page.shot(folder / "two.png")
        except BaseException:
            page.shot(folder / "failed.png")
            raise
        same(page.complaints(), [])
    with browser.Browser(is_dark=True) as page:
        page.open(one)
        same(page.js("getComputedStyle(document.body).backgroundColor"), "rgb(13, 17, 23)")
        page.shot(folder / "dark.png")
    return 0


sys.exit(main(*sys.argv[1:]))
