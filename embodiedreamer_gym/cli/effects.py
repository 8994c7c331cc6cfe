"""`embodiedreamer effects`."""

from embodiedreamer_gym.cli import options as o


@o.verb(o.LOGS[0], o.JSON)
def run(a, progress):
    """List the physical effects: symptom, parameters with units, what reveals each, what it is confused with."""
    from embodiedreamer_gym.effects import CATALOGUE, load_effects

    rows = []
    for name, kind in (load_effects(a.effects) if a.effects else CATALOGUE).items():
        units = ", ".join(f"{one.name} ({one.unit})" for one in kind.parameters)
        rows.append({"name": name, "symptom": kind.symptom, "parameters": units, "revealed by": kind.reveals,
                     "family": kind.family.replace("_", " ") or "-",
                     "confused with": ", ".join(kind.confused_with) or "-"})  # fmt: skip
    lines = ["\n  ".join([row["name"], *(f"{key + ':':<15}{row[key]}" for key in list(row)[1:])]) for row in rows]
    return o.Result("\n".join(lines), rows)
