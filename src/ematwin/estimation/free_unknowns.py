"""Free and held unknowns of an actuator, as a user names them."""

from collections.abc import Iterable, Mapping
from typing import Any

from ematwin.errors import InputError
from ematwin.models.base import Model
from ematwin.models.unknown import Unknown


def unknowns_of(
    model: Model, actuator: Any, only: Iterable[str] | None, held: Any
) -> tuple[list[Unknown], dict[str, float]]:
    """Free unknowns, and values of those that are held."""
    given = held if isinstance(held, Mapping) else {}
    places = {name: float(value) for name, value in given.items() if "." in name}
    for place, value in places.items():
        model.unknown(actuator, place).check(value)
    others = {name: value for name, value in given.items() if name not in places}
    values = model.values_of(actuator, others if places else held)
    every = [one for one in model.unknowns(actuator) if one.role in ("fault", "nuisance")]
    own = [one for one in every if not (one.marginal or one.name in given)]
    if only is None:
        free = own
    else:
        wanted = [model.unknown(actuator, name) for name in dict.fromkeys(only)]
        if both := [one.name for one in wanted if one.name in given]:
            raise InputError(f"{both[0]} cannot be searched and held; leave one of the two out.")
        if not wanted:
            raise InputError("No fault is left to search; name at least one, e.g. friction.")
        names = {one.name for one in wanted}
        # nuisances stay free: a load that was not recorded is unknown whatever is searched
        free = [one for one in own if one.name in names or one.role == "nuisance"]
        free += [one for one in wanted if one.role == "nominal" or one.marginal]
        unsearchable = [one.name for one in wanted if one.role == "symptom"]
        if unsearchable:
            raise InputError(
                f"{unsearchable[0]} is derived from what the twin leaves unexplained and cannot be "
                "searched; use ematwin detect."
            )
    left_out = {one.name for one in free}
    left_out |= {one.name for one in model.unknowns(actuator) if one.role == "symptom"}
    # held at healthy by nobody's wish: these join where intervals are formed
    left_out |= {one.name for one in every if one.marginal and one.name not in given}
    fixed = {**values, **places}
    return free, {name: value for name, value in fixed.items() if name not in left_out}


def searched(model: Model, actuator: Any) -> list[Unknown]:
    """Faults and nuisances: the unknowns of a search on healthy recordings."""
    return [
        one
        for one in model.unknowns(actuator)
        if one.role in ("fault", "nuisance") and not one.marginal
    ]
