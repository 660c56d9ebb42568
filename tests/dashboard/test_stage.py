"""Servers of pages, one after the other on one port, by which a browser knows their files."""

from __future__ import annotations

import socket

from dashboard.stage import Pages


def test_a_server_of_pages_has_the_port_of_one_that_has_ended():
    first, beside = Pages([]), Pages([])
    assert first.port != beside.port
    beside.kill()
    beside.kill()
    assert Pages([]).port == beside.port
    assert Pages([]).port not in {first.port, beside.port}


def test_a_port_that_another_process_has_taken_meanwhile_is_left_to_it():
    ended = Pages([])
    ended.kill()
    with socket.create_server(("127.0.0.1", ended.port), reuse_port=False):
        assert Pages([]).port != ended.port
