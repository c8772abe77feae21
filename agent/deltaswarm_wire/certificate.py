"""Check a certificate as the other end of a link would, which refuses a bad one without a message."""

import ssl
from typing import Any

from deltaswarm_wire.access import certified_name, revoked_beside
from deltaswarm_wire.session import Tls


def certificate_problem(tls: Tls, name: str) -> str:
    """What is wrong with a certificate, its key or its authority for a user called `name`; "" if nothing."""
    try:
        revoked = revoked_beside(tls.ca)
        shown_name = _shown_name(tls)
    except ssl.SSLCertVerificationError as error:
        return f"the other end would refuse it: {error.verify_message}"
    except ssl.SSLError as error:
        return f"it does not match its key or its authority: {error.reason or error}"
    except ValueError as error:
        return str(error)
    if shown_name == (needed := certified_name(name, revoked)):
        return ""
    state = ", which is revoked" if shown_name in revoked else ""
    return f"it must be the certificate of {needed} (got that of {shown_name}{state})"


def _shown_name(tls: Tls) -> str:
    """Read the name from a handshake with these files at both ends."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(tls.certificate, tls.key)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.load_verify_locations(tls.ca)
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    shown = client.wrap_bio(to_client, to_server)
    waiting = [shown, server.wrap_bio(to_server, to_client, server_side=True)]
    while waiting:
        try:
            waiting[0].do_handshake()
            waiting.pop(0)
        except ssl.SSLWantReadError:
            waiting.reverse()
    certificate: dict[str, Any] = shown.getpeercert() or {}
    names = [value for part in certificate["subject"] for key, value in part if key == "commonName"]
    return str(names[0]) if names else "nobody"
