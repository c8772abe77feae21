"""A stand-in for a service that recruits people for studies by link, to try the way there and back without an account.

It does what a study sees of such a service: it sends people to the open link with ids, takes them back with their
completion codes, and keeps the state of each. The states are those of Prolific.
"""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlencode, urlsplit

ACTIVE, REVIEW, RETURNED, TIMED_OUT = "active", "awaiting review", "returned", "timed out"
STAYS = (REVIEW, RETURNED, TIMED_OUT)
COOKIE = "recruited"


@dataclass
class Submission:
    """What the service knows of one person."""

    person: str
    state: str = ACTIVE
    code: str = ""
    """The completion code that the person came back with."""


class Recruiter:
    """A recruiting service on this machine, for the length of a `with` block.

    Args:
        id_parameter: parameter by which people's ids are passed on: `outside_id` of the table `[serve]`.

    Attributes:
        submissions: what became of each person, by id.
    """

    def __init__(self, id_parameter: str = "PROLIFIC_PID") -> None:
        self.submissions: dict[str, Submission] = {}
        self._parameter = id_parameter
        self._study, self._link = secrets.token_hex(12), ""
        recruiter = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                recruiter._answer(self)

            def log_message(self, format: str, *args: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    def __enter__(self) -> Recruiter:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self._server.server_port}"

    @property
    def return_url(self) -> str:
        """Where people come back: `return_url` of the table `[serve]`."""
        return f"{self.address}/submissions/complete?cc={{code}}"

    def publish(self, open_link: str) -> None:
        """Take the open link of a study, to which people are sent from then on."""
        self._link = open_link

    def invite(self) -> str:
        """Return the address at which a new person begins; a browser that opens it is known by a cookie."""
        person = secrets.token_hex(12)
        self.submissions[person] = Submission(person)
        return f"{self.address}/begin/{person}"

    def give_back(self, person: str) -> None:
        """Let a person return the place, as people do who change their mind."""
        self._move(person, RETURNED)

    def time_out(self, person: str) -> None:
        """Let a person's time be over."""
        self._move(person, TIMED_OUT)

    def _move(self, person: str, state: str) -> None:
        submission = self.submissions[person]
        submission.state = submission.state if submission.state in STAYS else state

    def _answer(self, request: BaseHTTPRequestHandler) -> None:
        url = urlsplit(request.path)
        _, kind, *rest = url.path.split("/")
        if kind == "begin" and rest and rest[0] in self.submissions:
            session = secrets.token_hex(12)
            ids = {self._parameter: rest[0], "STUDY_ID": self._study, "SESSION_ID": session}
            request.send_response(HTTPStatus.FOUND)
            request.send_header("Set-Cookie", f"{COOKIE}={rest[0]}; Path=/; SameSite=Lax")
            request.send_header("Location", f"{self._link}?{urlencode(ids)}")
            request.end_headers()
            return
        submission = self.submissions.get(_cookie(request))
        is_known = kind == "submissions" and submission is not None
        if submission is not None and is_known and submission.state not in STAYS:
            submission.code = (parse_qs(url.query).get("cc") or [""])[0]
            submission.state = REVIEW
        request.send_response(HTTPStatus.OK if is_known else HTTPStatus.NOT_FOUND)
        request.send_header("Content-Type", "text/plain; charset=utf-8")
        request.end_headers()
        request.wfile.write(b"Thank you." if is_known else b"Nobody is known here by that.")


def _cookie(request: BaseHTTPRequestHandler) -> str:
    try:
        found = SimpleCookie(request.headers.get("Cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found else ""
