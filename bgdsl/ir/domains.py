"""The physical domains: what effort and flow mean, and their units.

Effort times flow is power in every domain but `PseudoThermal` (temperature and heat flow). `Generic` says nothing and joins anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bgdsl.source import Span


@dataclass(frozen=True, slots=True)
class Domain:
    """A domain with the names and units of its effort and flow; a unit "" is left open. `span`: where a user's domain is
    defined, None for a built-in one."""

    name: str
    effort: str
    effort_unit: str
    flow: str
    flow_unit: str
    span: Span | None = None
    comment: str = ""


GENERIC = "Generic"

DOMAINS: Mapping[str, Domain] = {
    domain.name: domain
    for domain in (
        Domain("Translational", "force", "N", "velocity", "m/s"),
        Domain("Rotational", "torque", "N.m", "angular velocity", "rad/s"),
        Domain("Electrical", "voltage", "V", "current", "A"),
        Domain("Magnetic", "magnetomotive force", "A", "flux rate", "Wb/s"),
        Domain("Hydraulic", "pressure", "Pa", "volume flow", "m3/s"),
        Domain("Thermal", "temperature", "K", "entropy flow", "W/K"),
        Domain("PseudoThermal", "temperature", "K", "heat flow", "W"),
        Domain("Chemical", "chemical potential", "J/mol", "molar flow", "mol/s"),
        Domain(GENERIC, "effort", "", "flow", ""),
    )
}
"""The domains every model knows, by name."""
