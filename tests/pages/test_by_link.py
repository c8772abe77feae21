"""A study by link in a browser: door, station and overview; behind a proxy with TLS and a path, and within a frame."""

import http.server
import shutil
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from selenium import webdriver

from tests.support.by_link import Service, a_study, serving
from tests.support.station_page import NEEDS_BROWSER, Looking, browser
from tests.support.swarms import BOUND_S, wait_until

pytestmark = NEEDS_BROWSER

CADDY = shutil.which("caddy")
NEEDS_CADDY = pytest.mark.skipif(not CADDY, reason="caddy is not installed (Debian: caddy)")
CADDYFILE = """
{{
	admin off
	auto_https disable_redirects
	storage file_system {folder}
}}
https://localhost:{port} {{
	tls internal
	{handle} /swarm/* {{
		reverse_proxy 127.0.0.1:{behind}
	}}
	redir /swarm /swarm/
}}
"""
FRAME = """<!doctype html><iframe id="study" src="{link}" width="1200" height="700"></iframe>
<output id="told"></output>
<script>addEventListener("message", (e) => {{ document.getElementById("told").textContent = JSON.stringify(e.data); }});
</script>"""


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


@contextmanager
def windows(driver: webdriver.Chrome) -> Iterator[tuple[str, str]]:
    """Two windows: the participant's and the experimenter's."""
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    second = driver.current_window_handle
    yield first, second


def ends_by_the_overview(driver: webdriver.Chrome, study: str, overview: str) -> str:
    """Take part until the map is there; the experimenter ends the session; the code at the door."""
    page = Looking(driver)
    with windows(driver) as (first, second):
        driver.get(overview)
        driver.switch_to.window(first)
        driver.get(study)
        page.until(lambda: page.at("door-agree").is_displayed())
        assert "You may stop at any time." in page.text("door-consent")
        page.at("door-agree").click()
        page.until(lambda: "/run/" in driver.current_url)
        page.until(lambda: page.text("status") == "live")
        driver.switch_to.window(second)
        page.until(lambda: page.texts("#rows td")[1:2] == ["running"])
        page.all("#rows button")[0].click()
        driver.switch_to.alert.accept()
        driver.switch_to.window(first)
        page.until(lambda: "/run/" not in driver.current_url and page.text("door-code-value"))
        assert page.at("door-back").get_attribute("href").endswith(f"?cc={page.text('door-code-value')}")
        return page.text("door-code-value")


def test_from_the_open_link_to_the_code(tmp_path: Path) -> None:
    """The same browser comes back by the open link to the same place."""
    with serving(a_study(tmp_path, speed=5.0)) as service, browser() as driver:
        code = ends_by_the_overview(driver, service.open_link, service.overview)
        own = driver.current_url
        driver.get(service.open_link)
        page = Looking(driver)
        page.until(lambda: driver.current_url == own and page.text("door-code-value") == code)


@contextmanager
def behind_caddy(folder: Path, handle: str) -> Iterator[tuple[Service, str, int]]:
    """Serve a study behind a proxy; the study, its public address without the path, and the port behind."""
    port, behind = free_port(), free_port()
    public = f"https://localhost:{port}"
    (folder / "Caddyfile").write_text(
        CADDYFILE.format(folder=folder / "caddy", port=port, behind=behind, handle=handle)
    )
    options = ("--listen", f"127.0.0.1:{behind}", "--public", f"{public}/swarm")
    command = [CADDY or "", "run", "--config", str(folder / "Caddyfile"), "--adapter", "caddyfile"]
    with (
        serving(a_study(folder, speed=5.0), *options) as service,
        subprocess.Popen(command, stderr=subprocess.DEVNULL, env={"HOME": str(folder)}) as proxy,
    ):
        try:
            wait_until(lambda: is_there(port), "the proxy", BOUND_S)
            yield service, public, behind
        finally:
            proxy.terminate()


def is_there(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


@NEEDS_CADDY
@pytest.mark.parametrize("handle", ["handle_path", "handle"])
def test_behind_a_proxy_with_tls_below_a_path(tmp_path: Path, handle: str) -> None:
    """Whether the proxy removes the path or keeps it; also without the last slash."""
    with behind_caddy(tmp_path, handle) as (service, public, _), browser(insecure=True) as driver:
        assert service.open_link.startswith(f"{public}/swarm/j/")
        assert ends_by_the_overview(driver, service.open_link.rstrip("/"), service.overview)
        assert urlsplit(driver.current_url).scheme == "https"


@pytest.mark.parametrize("is_allowed", [True, False])
def test_one_origin_may_embed_it_and_is_told_the_code(tmp_path: Path, is_allowed: bool) -> None:
    """Another origin shows nothing."""
    folder = tmp_path / "survey"
    folder.mkdir()
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as survey:
        threading.Thread(target=survey.serve_forever, daemon=True).start()
        origin = f"http://127.0.0.1:{survey.server_port}"
        allowed = origin if is_allowed else "https://survey.example.org"
        with serving(a_study(tmp_path, speed=5.0), "--embed", allowed) as service, browser() as driver:
            (folder / "index.html").write_text(FRAME.format(link=service.open_link))
            driver.get(f"{origin}/index.html")
            page = Looking(driver)
            driver.switch_to.frame("study")
            if not is_allowed:
                assert not page.all("#door-agree")
                survey.shutdown()
                return
            page.until(lambda: page.at("door-agree").is_displayed())
            page.at("door-agree").click()
            page.until(lambda: page.all("#status") and page.text("status") == "live")
            driver.switch_to.new_window("tab")
            driver.get(service.overview)
            page.until(lambda: page.texts("#rows td")[1:2] == ["running"])
            page.all("#rows button")[0].click()
            driver.switch_to.alert.accept()
            driver.switch_to.window(driver.window_handles[0])
            page.until(lambda: '"state":"ended"' in page.text("told") and '"code":' in page.text("told"))
        survey.shutdown()
