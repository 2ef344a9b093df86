"""Serves the live page on this machine, and says where it is."""

import getpass
import ipaddress
import socket
from collections.abc import Sequence
from typing import NamedTuple

import tasks
from analysis.program import CommandError
from launch.folder import policies
from launch.jobs.local import StopSignal
from launch.pictures import scene
from launch.viewing.page import Page

LOOPBACK = "127.0.0.1"
PORT = 8123

_OPEN = "warning: anybody who can reach {host} can use this page; it has no password"


class Address(NamedTuple):
    """Where a page is asked for."""

    host: str
    port: int


def check() -> None:
    """Raises CommandError where the extra that draws the page is not installed."""
    try:
        scene.load()
    except scene.ViewerMissing as error:
        raise CommandError(str(error)) from error


def serve(
    found: Sequence[policies.Found],
    chosen: policies.Found,
    *,
    word: str,
    address: Address,
    stop: StopSignal,
) -> None:
    """Serves the page of a task's policies until `stop` is set.

    Args:
      found: all that can be chosen on the page.
      chosen: the one that it begins with.
      word: finds the task.

    Raises:
      CommandError: the policy cannot be played, or nothing can listen at the address.
    """
    _check_address(address)
    env = tasks.load_vector(word, 1)
    server = scene.private(*address)
    try:
        own = [policy for policy in found if policy.task == chosen.task]
        page = Page(server, env, env.spec, own, chosen)
        for line in told(address.host, server.get_port()):
            print(line, flush=True)
        page.run(lambda: stop.number is not None)
    finally:
        scene.stop(server)
        env.close()


def _check_address(address: Address) -> None:
    try:
        family, *_, where = socket.getaddrinfo(address.host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as probe:
            probe.bind(where)
    except (OSError, ValueError) as error:  # no address; no name that could be one
        raise CommandError(f"flag --host={address.host}: cannot listen there: {error}") from error


def told(host: str, port: int) -> list[str]:
    """What a person is told: the address, and how to reach it from another machine."""
    own = _is_loopback(host)
    shown = host if own else socket.gethostname()
    lines = [f"view: http://{shown}:{port}   (Ctrl-C stops it)"]
    if own:
        lines.append(
            f"over ssh: ssh -L {port}:{host}:{port} {getpass.getuser()}@{socket.gethostname()}, "
            "and open the address above there"
        )
    else:
        lines.append(_OPEN.format(host=host))
    return lines


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
