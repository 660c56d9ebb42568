"""The link of an instance to its router: when only another process is let in again."""

from __future__ import annotations

from dataclasses import dataclass

from caesura_service.server.router_link import KEPT_OUT_S, LOOK_S, RouterLink


@dataclass
class IntermittentRouter:
    """That lets others in or not, at a time."""

    now: float = 0.0
    lets_in: bool = True
    asked: int = 0

    def ask(self) -> bool:
        self.asked += 1
        return self.lets_in


def looks(link: RouterLink, router: IntermittentRouter, seconds: float) -> list[bool]:
    """What each look says, five a second."""
    found = []
    for _ in range(round(seconds * 5)):
        router.now += 0.2
        found.append(link.is_kept_out())
    return found


def link_of(router: IntermittentRouter) -> RouterLink:
    return RouterLink(router.ask, lambda: router.now)


def test_others_that_come_in_for_a_while_say_that_this_instance_is_kept_out():
    router = IntermittentRouter()
    link = link_of(router)
    link.report(False)
    assert not any(looks(link, router, KEPT_OUT_S - 1.0))
    assert any(looks(link, router, 2 * LOOK_S + 1.0))
    assert router.asked <= (KEPT_OUT_S + 2 * LOOK_S) / LOOK_S + 1


def test_a_router_that_is_away_keeps_no_instance_out():
    router = IntermittentRouter(lets_in=False)
    link = link_of(router)
    link.report(False)
    assert not any(looks(link, router, 10 * KEPT_OUT_S))
    router.lets_in = True
    assert not any(looks(link, router, KEPT_OUT_S - 1.0)), "it has just come back"


def test_with_a_link_nothing_is_tried_and_a_new_loss_counts_anew():
    router = IntermittentRouter()
    link = link_of(router)
    assert not any(looks(link, router, 2 * KEPT_OUT_S))
    assert router.asked == 0
    link.report(False)
    assert not any(looks(link, router, KEPT_OUT_S - 1.0))
    link.report(True)
    assert not any(looks(link, router, 1.0))
    link.report(False)
    assert not any(looks(link, router, KEPT_OUT_S - 1.0))
