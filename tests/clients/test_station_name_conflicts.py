"""Which sessions of a station are taught at once: those that grow in turn, as long as they do."""

from caesura_clients.station_name_conflicts import PARTED_S, ParallelSessions, in_words


def grown(found: ParallelSessions, *reached: tuple[str, float], station: str = "cell-1") -> tuple[str, ...]:
    for session, t in reached:
        found.reach(station, session, t)
    return found.at(station)


def test_two_sessions_that_grow_in_turn_are_taught_at_once():
    found = ParallelSessions()
    assert grown(found, ("s1", 10.0), ("s2", 0.0), ("s1", 10.1), ("s2", 0.1)) == ()
    assert grown(found, ("s1", 10.2)) == ("s1", "s2")
    assert found.at("cell-2") == ()
    assert in_words("cell-1", ("s1", "s2")) == "two bridges teach at cell-1: s1 and s2"


def test_a_session_that_a_new_one_takes_the_place_of_is_not():
    found = ParallelSessions()
    grown(found, *(("s1", 0.1 * i) for i in range(50)))
    assert grown(found, *(("s2", 0.1 * i) for i in range(50))) == ()
    assert grown(found, *(("s1", 4.9) for _ in range(50))) == ()  # stated again, not grown


def test_one_whose_bridge_has_left_and_one_that_is_over_are_taught_no_more():
    turns = [(name, 0.1 * i) for i in range(4) for name in ("s1", "s2")]
    found = ParallelSessions()
    assert grown(found, *turns) == ("s1", "s2")
    assert grown(found, *(("s2", 0.3 + 0.1 * i) for i in range(round(PARTED_S / 0.1) + 2))) == ()
    again = ParallelSessions()
    grown(again, *turns)
    again.close("cell-1", "s1")
    assert again.at("cell-1") == ()


def test_three_sessions_are_all_named():
    turns = [(name, 0.1 * i) for i in range(4) for name in ("s1", "s2", "s3")]
    assert in_words("cell-1", grown(ParallelSessions(), *turns)) == (
        "3 bridges teach at cell-1: s1 and s2 and s3"
    )
