"""Who may enter: a token where others can reach the page, and no other web site's requests."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

from layered_cbf_ros.errors import ParameterError

SHORTEST_TOKEN = 16
"""A token that a person chooses has so many characters at least."""


def is_loopback(host: str) -> bool:
    """Tell whether a host name or address is this machine, seen by itself."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Door:
    """The rules of one front.

    Attributes:
        local: Whether it is bound to this machine alone.
        token: What a visitor has to know, '' if nothing.
        cookie: Name of the cookie that remembers it; of each port another one.
    """

    local: bool
    token: str
    cookie: str

    def knows(self, given: str) -> bool:
        """Tell, in constant time, whether a visitor knows the token."""
        return hmac.compare_digest(given.encode(errors='replace'), self.token.encode())

    def admits(self, cookies: Mapping[str, str], query: Mapping[str, str]) -> bool:
        """Tell whether a request brings the token, in a cookie or its address."""
        by_cookie = self.knows(cookies.get(self.cookie, ''))
        by_address = self.knows(query.get('token', ''))
        return not self.token or by_cookie or by_address

    def is_for_us(self, host: str) -> bool:
        """Tell whether a Host header may be ours.

        A page of another site can have its name resolved to this machine and then talk to
        us as if to itself. So on this machine only its own names count; elsewhere the
        token does, which such a page doesn't have.
        """
        return not self.local or is_loopback(urlsplit(f'//{host}').hostname or '')

    def is_same_site(self, origin: str, host: str) -> bool:
        """Tell whether a page that acts, by its Origin header, came from us."""
        parts = urlsplit(origin)
        return parts.scheme in ('http', 'https') and bool(host) and parts.netloc == host


def make_door(host: str, port: int, token: str) -> Door:
    """Return the door of a front.

    Args:
        host: Address that it is bound to.
        port: Its port.
        token: What a visitor has to know; '' for none on this machine, else for a new one.

    Raises:
        ParameterError: If the token is too short to keep anybody out.
    """
    local = is_loopback(host)
    if token and len(token) < SHORTEST_TOKEN:
        raise ParameterError(
            f'--token has {len(token)} characters; give {SHORTEST_TOKEN} or more, '
            'or leave it out for a new one'
        )
    if not token and not local:
        token = secrets.token_urlsafe(24)
    return Door(local, token, f'layered_cbf_{port}')
