"""A headless Chromium for tests of the report page, driven by Selenium."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.support.wait import WebDriverWait

from tests.support.command_line import WAIT_S

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
DRIVER = shutil.which("chromedriver")
# CI has a browser: there its tests fail without one (.github/workflows).
needs_browser = pytest.mark.skipif(
    not (CHROMIUM and DRIVER or os.environ.get("REQUIRE_BROWSER")),
    reason="needs chromium and chromedriver (Debian: chromium, chromium-driver)",
)
# Containers have neither the namespaces that the sandbox needs nor a sound card.
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--mute-audio",
    "--force-color-profile=srgb",
)


class Browser(webdriver.Chrome):
    """One page of 1400 x 900 pixels; use it in a `with` block."""

    def __init__(self) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for argument in (*ARGUMENTS, "--window-size=1400,900"):
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        # Without a path, Selenium would download a driver.
        super().__init__(
            options=options, service=webdriver.ChromeService(executable_path=DRIVER)
        )

    def open(self, page: Path) -> None:
        """Load a local file."""
        self.get(page.resolve().as_uri())

    def value(self, expression: str, *arguments: object) -> Any:
        """The value of a JavaScript expression, which may use `arguments`."""
        return self.execute_script(f"return {expression}", *arguments)

    def texts(self, selector: str) -> list[str]:
        """The text of each element."""
        return self.value(
            "[...document.querySelectorAll(arguments[0])].map(e => e.textContent)",
            selector,
        )

    def wait(self, condition: str) -> None:
        """Wait until a JavaScript expression is true."""
        until = WebDriverWait(self, timeout=WAIT_S, poll_frequency=0.05).until
        until(
            lambda page: page.value(f"Boolean({condition})"), f"never true: {condition}"
        )

    def click(self, selector: str, *, across: float = 0.5) -> None:
        """Click with the mouse into an element, at this share of its width."""
        element = self.find_element(By.CSS_SELECTOR, selector)
        self.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
        offset_px = round((across - 0.5) * element.rect["width"])
        ActionChains(self).move_to_element_with_offset(
            element, offset_px, 0
        ).click().perform()

    def press(self, key: str, *, until: str = "true") -> None:
        """Press and release a key, and wait for an expression;
        `selenium.webdriver.Keys` names special keys.
        """
        ActionChains(self).send_keys(key).perform()
        self.wait(until)

    def set_dark(self, dark: bool) -> None:
        """Set the colour scheme that the system asks for."""
        feature = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})

    def set_size(self, width: int, height: int) -> None:
        """Set the size of the page in pixels, as on a telephone or a wide screen."""
        metrics = {
            "width": width,
            "height": height,
            "deviceScaleFactor": 1,
            "mobile": False,
        }
        self.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def console(self) -> list[str]:
        """Messages of the console since the last call: errors, refused scripts and
        requests.
        """
        return [entry["message"] for entry in self.get_log("browser")]


@contextmanager
def open_browser() -> Iterator[Browser]:
    """A browser whose driver is reached without the proxy that the shell may name: it
    runs on this machine.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("no_proxy", "*")
        with Browser() as browser:
            yield browser
