"""Rendezvous hashing: everybody agrees, everybody has a share, and nothing moves that need not."""

from __future__ import annotations

import subprocess
import sys

from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_service.ownership.station_assignment import owner_of, stations_of

names = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,20}", fullmatch=True)
groups = st.lists(names, min_size=2, max_size=8, unique=True)
STATIONS = [f"cell-{number}" for number in range(1, 1001)]


@given(groups, names, st.randoms())
def test_the_order_in_which_they_were_met_does_not_matter(instances, station, random):
    shuffled = [*instances]
    random.shuffle(shuffled)
    assert owner_of(station, shuffled) == owner_of(station, instances)


@given(groups, st.sets(names))
def test_every_station_has_exactly_one_owner(instances, stations):
    shares = [stations_of(instance, instances, stations) for instance in instances]
    assert sum(len(share) for share in shares) == len(stations)
    assert frozenset().union(*shares) == stations


@given(groups, st.sets(names))
def test_who_leaves_gives_only_its_own_away_and_who_comes_takes_only_for_itself(instances, stations):
    *others, leaver = instances
    for station in stations:
        before, after = owner_of(station, instances), owner_of(station, others)
        assert before in {after, leaver}


@given(groups)
@settings(deadline=None)
def test_shares_are_nearly_even(instances):
    fair = len(STATIONS) / len(instances)
    for instance in instances:
        assert 0.5 * fair < len(stations_of(instance, instances, STATIONS)) < 1.6 * fair


def test_another_process_comes_to_the_same_answer():
    ask = (
        "from caesura_service.ownership.station_assignment import owner_of;"
        "print(*[owner_of(f'cell-{n}', {'a', 'b', 'c'}) for n in range(20)])"
    )
    said = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout
    assert said.split() == [owner_of(f"cell-{number}", {"a", "b", "c"}) for number in range(20)]
