"""The order of a user's method, measured when it is registered: a wrong statement is refused."""

from __future__ import annotations

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.own.registration import measured_order, unregister
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting

SHIPPED = {
    m.name: m for m in INTEGRATORS.values() if isinstance(m, Splitting | Tableau) and len(m.source) > 10 and not m.bath
}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_measured_order_is_the_published_one(name):
    method = SHIPPED[name]
    assert measured_order(method) == pytest.approx(method.order, abs=0.3)


def test_a_stated_order_that_is_too_high_is_refused():
    row = {"word": "ABA", "source": "Verlet 1967", "check_order": True}
    with pytest.raises(InputError, match=r"mine: the order is stated as 4, but measured as 2\.0"):
        kd.register_splitting("mine", order=4, **row)
    assert "mine" not in INTEGRATORS
    kd.register_splitting("mine", order=2, **row)
    unregister("mine")
    with pytest.raises(InputError, match=r"heuns: the order is stated as 3, but measured as 2\.0"):
        kd.register_tableau("heuns", [[1.0]], [0.5, 0.5], order=3, source="Heun 1900", check_order=True)


def test_nodes_of_a_tableau_count():
    """f depends on time, so a tableau whose rows do not add up to the nodes of its order loses that order."""
    wrong = Tableau("wrong", ((0.4,),), (0.0, 1.0), 2, "the midpoint rule with a wrong node")
    assert measured_order(wrong) == pytest.approx(1.0, abs=0.2)
