"""One contract for both transports, and what only a real network can do."""

import doctest
import re
import threading

import pytest

from caesura_clients import connect, service_liveliness
from caesura_clients.query import no_service, service_status
from caesura_protocol import recording
from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.errors import CaesuraError, ProtocolError, Unreachable
from caesura_protocol.transport import default_endpoint, memory, zenoh_transport
from caesura_protocol.transport import inbox as inbox_module
from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT
from caesura_protocol.transport.inbox import Inbox, ReceivedSample, TokenChange
from caesura_protocol.transport.memory import intersect
from caesura_protocol.transport.zenoh_transport import ZenohTransport, endpoint_of
from clients.conftest import RouterNetwork, free_port
from clients.fake_service import DEADLINE_S, eventually
from harness.processes import Router, running

TEXT = Encoded(b"\x00hello\xff", "application/msgpack;caesura.Ack.v1")
OTHER = Encoded(b"again", "application/msgpack;caesura.Close.v1")
KEY, ANY = "caesura/v1/station/cell-1/samples", "caesura/v1/station/*/samples"


def received(transport, key, inbox, content=TEXT):
    """Put until the declaration has travelled: a subscriber hears only what is put after that."""
    for _ in range(400):
        transport.put(key, content)
        if item := inbox.get(0.01):
            return item
    raise AssertionError("nothing arrived")


@pytest.mark.parametrize("pattern", [KEY, ANY])
def test_what_is_put_arrives_with_its_key_and_encoding(network, pattern):
    inbox = Inbox()
    here, there = network.transport(), network.transport()
    with there.subscribe(pattern, inbox):
        assert received(here, KEY, inbox) == ReceivedSample(KEY, *TEXT)


def test_a_subscription_ends_with_its_context(network):
    inbox, other = Inbox(), Inbox()
    transport = network.transport()
    with transport.subscribe(KEY, inbox):
        received(transport, KEY, inbox)
    while inbox.get(0.0):
        pass
    with transport.subscribe(KEY, other):
        received(transport, KEY, other)
    assert inbox.get(0.0) is None


def answering(network, *, refuse=None):
    """A peer that answers every question on KEY twice, or refuses it."""
    inbox = Inbox()

    def answer():
        question = inbox.get(DEADLINE_S)
        with question:
            seen.append((question.key, question.parameters, question.content))
            if refuse:
                question.refuse(encode_error(refuse))
            else:
                question.reply(KEY, TEXT)
                question.reply(KEY, OTHER)

    seen = []
    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    return network.transport().declare_queryable(KEY, inbox), seen


def asked(transport, *arguments, **options):
    """Ask until the declaration has travelled: nobody there is an answer too."""
    for _ in range(200):
        answers = transport.query(*arguments, **options)
        if answers.replies or answers.refusals:
            return answers
        threading.Event().wait(0.005)
    raise AssertionError("nobody answered")


def test_a_query_brings_every_answer_in_order(network):
    answer, seen = answering(network)
    with answer:
        answers = asked(network.transport(), KEY, OTHER, parameters="from=1;to=2")
    assert answers.replies == (ReceivedSample(KEY, *TEXT), ReceivedSample(KEY, *OTHER))
    assert seen == [(KEY, "from=1;to=2", OTHER)]


def test_a_refusal_arrives_as_the_error_that_it_was(network):
    answer, _ = answering(network, refuse=ProtocolError("evicted", "gone", value=3, limit=9))
    with answer:
        (refusal,) = asked(network.transport(), KEY).refusals
    assert (refusal.code, refusal.value, refusal.limit) == ("evicted", 3, 9)


def test_a_question_without_an_answer_comes_back_empty_at_once(network):
    # Waiting would take longer than a test may.
    assert network.transport().query(KEY, timeout_s=1000.0) == ((), ())


def test_a_query_that_is_received_and_not_answered_in_time_is_refused_as_overloaded(network):
    with network.transport().declare_queryable(KEY, Inbox()):
        refusals = []
        eventually(
            lambda: refusals.extend(network.transport().query(KEY, timeout_s=0.2).refusals) or refusals
        )
    assert {(one.code, one.message.partition(":")[0]) for one in refusals} == {
        ("overloaded", "no answer in 0.2 s")
    }


def test_tokens_are_seen_by_who_came_before_and_by_who_comes_after(network):
    before, after = Inbox(), Inbox()
    here, there = network.transport(), network.transport()
    key, pattern = "caesura/v1/station/cell-1/alive", "caesura/v1/station/*/alive"
    with there.watch_liveliness(pattern, before):
        with here.declare_token(key):
            assert before.get(DEADLINE_S) == TokenChange(key, alive=True)
            with there.watch_liveliness(pattern, after):
                assert after.get(DEADLINE_S) == TokenChange(key, alive=True)
            assert there.list_tokens(pattern) == (key,)
        seen = iter(lambda: before.get(DEADLINE_S), None)
        assert TokenChange(key, alive=False) in seen  # it may have been reported as there once more
        eventually(lambda: there.list_tokens(pattern) == ())


def test_no_token_is_overlooked(network):
    """Once asked through the session that watches: zenoh 1.10.2 then overlooked 3 % on a busy machine."""
    here, there = network.transport(), network.transport()
    pattern = "caesura/v1/station/*/alive"
    with here.declare_token("caesura/v1/station/cell-1/alive"), there.watch_liveliness(pattern, Inbox()):
        eventually(lambda: there.list_tokens(pattern) != ())
        assert all(there.list_tokens(pattern) for _ in range(200))


def test_a_question_that_an_inbox_has_no_room_for_is_refused_as_overloaded(network):
    inbox = Inbox(capacity=1)
    here, there = network.transport(), network.transport()
    with there.declare_queryable(KEY, inbox):
        eventually(lambda: there.query(KEY, timeout_s=0.05) is not None and len(inbox) == 1)
        dropped = []
        first = threading.Thread(target=lambda: dropped.extend(here.query(KEY, timeout_s=2.0).refusals))
        first.start()
        eventually(lambda: inbox.dropped == 1)
        here.query(KEY, timeout_s=0.05)
        first.join(30.0)
    assert [refusal.code for refusal in dropped] == ["overloaded"]


def test_a_full_inbox_drops_the_oldest_and_counts():
    inbox = Inbox(capacity=2)
    for number in range(5):
        inbox.offer(TokenChange(str(number), alive=True))
    assert (inbox.dropped, inbox.get(0.0).key, inbox.get(0.0).key) == (3, "3", "4")
    assert inbox.get(0.0) is None


def test_a_full_inbox_is_full_of_bytes_too_and_one_item_always_fits():
    inbox = Inbox(capacity_bytes=100)
    for number, size in enumerate((40, 40, 30, 200)):
        inbox.offer(ReceivedSample(str(number), bytes(size), ""))
        assert len(inbox) == (1, 2, 2, 1)[number]
    assert (inbox.dropped, inbox.get(0.0).key) == (3, "3")
    inbox.offer(ReceivedSample("4", bytes(100), ""))
    assert inbox.get(0.0).key == "4"


@pytest.mark.parametrize(
    "module",
    [default_endpoint, service_liveliness, inbox_module, memory, recording, zenoh_transport],
    ids=lambda one: one.__name__,
)
def test_the_examples_in_docstrings_hold(module):
    result = doctest.testmod(module)
    assert (result.failed, result.attempted > 0) == (0, True)


def test_key_expressions_meet_part_by_part():
    assert intersect(ANY, KEY)
    assert not intersect(ANY, KEY + "/more")
    assert not intersect("a/b", "a/c")


def test_connecting_waits_for_a_router_that_comes_later():
    network = RouterNetwork()
    opened = []
    thread = threading.Thread(target=lambda: opened.append(network.transport()), daemon=True)
    thread.start()
    assert not opened
    with network:
        thread.join(30.0)
        assert opened[0].list_tokens("a/*") == ()


def test_connecting_without_an_endpoint_takes_that_of_the_environment(monkeypatch):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setenv("CAESURA_CONNECT", endpoint)
    with pytest.raises(Unreachable, match=endpoint):
        connect(timeout_s=0.2)


def test_connecting_in_vain_says_where():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(Unreachable, match=endpoint):
        ZenohTransport(endpoint, timeout_s=0.1)


@pytest.mark.parametrize("endpoint", ["nonsense", "tcp/", "quux/127.0.0.1:1"])
def test_an_endpoint_that_makes_no_sense_is_named(endpoint):
    with pytest.raises(CaesuraError, match=endpoint):
        ZenohTransport(endpoint, timeout_s=0.1)


def test_a_config_file_is_read_and_the_settings_still_hold(router, tmp_path):
    file = tmp_path / "client.json5"
    file.write_text('{metadata: {name: "cell-1"}, scouting: {multicast: {enabled: true}}}')
    with ZenohTransport(router.endpoint, config_file=file, timeout_s=DEADLINE_S) as transport:
        assert transport.list_tokens("a/*") == ()


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp/127.0.0.1:99999", "port 99999, expected 0 to 65535"),
        ("tpc/127.0.0.1:7447", "protocol 'tpc', expected one of tcp, tls"),
        ("tcp/127.0.0.1", "'tcp/127.0.0.1' is no endpoint: write it as tcp/127"),
    ],
)
def test_an_endpoint_that_no_router_can_have_is_refused_at_once(endpoint: str, why: str, tmp_path):
    """Bridge, recorder and dashboard asked for ever whether the service was running."""
    file = tmp_path / "client.json5"
    file.write_text(f'{{connect: {{endpoints: ["{endpoint}"]}}}}')
    for given in ((endpoint, None), (None, file)):
        with pytest.raises(CaesuraError, match=re.escape(why)):
            endpoint_of(*given)


@pytest.mark.parametrize("named", ['["{0}"]', '{{"client": ["{0}"], "router": []}}'])
def test_a_config_file_names_the_router_unless_the_command_line_does(router, tmp_path, named):
    file = tmp_path / "client.json5"
    file.write_text(f'{{"connect": {{"endpoints": {named.format(router.endpoint)}}}}}')
    with ZenohTransport(config_file=file, timeout_s=DEADLINE_S) as transport:
        assert transport.endpoint == router.endpoint
        assert transport.list_tokens("caesura/v1/service/*/alive") == ()
    with pytest.raises(Unreachable, match="tcp/127"):
        ZenohTransport("tcp/127.0.0.1:1", config_file=file, timeout_s=0.1)


@pytest.mark.parametrize(
    "content", ["{}", '{"mode": "client", "connect": {"endpoints": {"router": ["tcp/h:1"]}}}']
)
def test_where_no_router_is_named_it_is_the_one_of_this_machine(tmp_path, content):
    file = tmp_path / "client.json5"
    file.write_text(content)
    assert endpoint_of(None, file) == endpoint_of(None, None) == DEFAULT_ENDPOINT
    assert endpoint_of("tcp/h:2", file) == "tcp/h:2"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{nonsense: ", "client.json5 with endpoint 'tcp/127.0.0.1:7447': --> 1:"),
        ("{nonsense: 5}", "unknown field `nonsense`"),
        ("{connect: {endpoints: 3}}", "invalid type: integer `3`"),
    ],
)
def test_a_config_file_that_makes_no_sense_is_named_without_the_librarys_own_sources(
    tmp_path, content, reason
):
    # A place in /root/.cargo and the names of Rust types once stood in the message.
    file = tmp_path / "client.json5"
    file.write_text(content)
    with pytest.raises(CaesuraError) as caught:
        ZenohTransport("tcp/127.0.0.1:7447", config_file=file, timeout_s=0.1)
    message = str(caught.value)
    assert reason in message
    for foreign in (" at /", ".cargo", "Message {", "Some(", "\n"):
        assert foreign not in message


def test_a_closed_transport_raises_our_own_error(router):
    transport = router.transport()
    transport.close()
    with pytest.raises(Unreachable):
        transport.put(KEY, TEXT)


def test_a_session_outlives_its_router(router):
    inbox = Inbox()
    here, there = router.transport(), router.transport()
    with there.subscribe(KEY, inbox):
        received(here, KEY, inbox)
        router.stop()
        here.put(KEY, TEXT)
        router.start()
        assert received(here, KEY, inbox, OTHER).key == KEY


@pytest.mark.slow
def test_a_router_that_hangs_is_named_and_serves_the_same_session_again_afterwards():
    """It read "no service is alive", as where only the service has ended."""
    with running(Router()) as router, ZenohTransport(router.endpoint, timeout_s=DEADLINE_S) as transport:
        assert transport.has_router
        assert "no service is alive" in str(no_service(transport))
        router.freeze()
        eventually(lambda: not transport.has_router)
        assert f"no service can be reached: the router at {router.endpoint} has ended" in str(
            no_service(transport)
        )
        router.thaw()
        eventually(lambda: transport.has_router)
        with pytest.raises(Unreachable, match="no service is alive"):
            service_status(transport)
