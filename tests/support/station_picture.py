"""`python -m tests.support.station_picture docs/station/live.png`: take the picture of the page that the docs show."""

import sys

from selenium.webdriver.support.ui import Select

from tests.support.station_feed import Feed, Swarm
from tests.support.station_page import Page, browser

ORDERS = [
    [1, "set delta", ["all"], {"delta": 2}, 20.0, 11, 11, 0, 140.0, "done", 0, []],
    [2, "attend a place", ["place", 70, 30], {}, 160.0, 4, 1, 2, 280.0, "heard", 0, [4, 8]],
]


def take(file: str) -> None:
    """Play two hundred seconds of the scripted swarm, write an order to a circle, and take the picture."""
    size = {"width": 1366, "height": 768, "deviceScaleFactor": 1, "mobile": False}
    with browser() as driver, Feed() as feed:
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        page = Page(driver, Swarm(commands=ORDERS), feed)
        for time_s in range(0, 202, 3):
            page.player.show(float(time_s))
            page.until(lambda time_s=time_s: page.text("time") == f"{time_s // 60}:{time_s % 60:02}")
        Select(page.at("command-name")).select_by_value("set delta")
        page.all('input[name="target"][value="circle"]')[0].click()
        for name, value in (("command-x", "30"), ("command-y", "60"), ("command-radius", "18")):
            page.at(name).clear()
            page.at(name).send_keys(value)
        page.until(lambda: "attend a place" in page.text("fates"))
        page.drawn()
        driver.save_screenshot(file)


if __name__ == "__main__":
    take(sys.argv[1])
