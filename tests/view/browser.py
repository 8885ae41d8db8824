"""Debian's chromium without a window, on a page of `porttape view`."""

import pathlib
import shutil
import sys

CHROMIUM = "/usr/bin/chromium"
DRIVER = "/usr/bin/chromedriver"
SECONDS = 20  # until what is waited for is given up
STARTS = 3    # a busy machine may be too slow for the browser's own limits, or give its port to another program
LATE_FRAMES = """
const soon = requestAnimationFrame;
window.requestAnimationFrame = draw => setTimeout(() => soon(draw), %d);
"""


def missing():
    """What of it this machine lacks; empty: nothing."""
    lacks = [path for path in (CHROMIUM, DRIVER) if not shutil.which(path)]
    try:
        import selenium  # noqa: F401
    except ImportError:
        lacks.append("selenium")
    return ", ".join(lacks)


class Browser:
    """A page at a time. Use as a context: the browser ends with it.

    Frames that the page asks for come `late_ms` later: what does not wait for them is found out, however fast the machine.
    """

    def __init__(self, is_dark=False, size=(1600, 1080), late_ms=0):
        from selenium.webdriver.chrome.options import Options
        options = Options()
        options.binary_location = CHROMIUM
        for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
                     "--disable-background-networking", f"--window-size={size[0]},{size[1]}"):
            options.add_argument(word)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = self.started(options)
        if late_ms: self.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": LATE_FRAMES % late_ms})
        scheme = "dark" if is_dark else "light"
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]})

    @staticmethod
    def started(options):
        from selenium.common.exceptions import WebDriverException
        from selenium.webdriver import Chrome
        from selenium.webdriver.chrome.service import Service
        for start in range(1, STARTS + 1):
            try:
                return Chrome(service=Service(DRIVER), options=options)
            except WebDriverException as error:
                print(f"chromium, start {start} of {STARTS}: {error}", file=sys.stderr)
                if start == STARTS: raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.driver.quit()

    def open(self, page, address=""):
        self.driver.get("about:blank")
        self.driver.get(pathlib.Path(page).resolve().as_uri() + address)
        self.until("document.body.dataset.ready === 'judged'")

    def js(self, expression, *values):
        return self.driver.execute_script(f"return {expression}", *values)

    def until(self, expression, *values):
        """Waits until an expression of JavaScript is true."""
        from selenium.webdriver.support.ui import WebDriverWait
        WebDriverWait(self.driver, SECONDS, poll_frequency=0.02).until(lambda _: self.js(expression, *values), f"never true: {expression}")

    def find(self, selector):
        return self.driver.find_element("css selector", selector)

    def text(self, selector):
        """What is written there, as a person reads it."""
        return self.js("document.querySelector(arguments[0])?.innerText ?? ''", selector)

    def shows(self, selector, words):
        """Waits until these words are written there."""
        from selenium.common.exceptions import TimeoutException
        try:
            self.until("(document.querySelector(arguments[0])?.innerText ?? '').includes(arguments[1])", selector, words)
        except TimeoutException:
            raise AssertionError(f"{selector} shows {self.text(selector)!r}, never {words!r}") from None

    def keys(self, *keys):
        """Typed to whatever has the focus."""
        self.driver.switch_to.active_element.send_keys(*keys)

    def shot(self, path):
        self.driver.save_screenshot(str(path))

    def complaints(self):
        """What the browser has said of the page."""
        return [entry["message"] for entry in self.driver.get_log("browser")]
