"""The tables of a study's keys in docs/reference/studies.md, made of what the classes say of themselves."""

import inspect
import json
import re
from dataclasses import MISSING, fields

import stepper

PARTS = (("", stepper.lab.Study), ("[[outcomes]]", stepper.lab.Outcome), ("[parameters.NAME]", stepper.lab.Parameter))
IN_TOML = {
    "model": 'a path beside the file, MJCF, or "file.py:function"',
    "controller": '"file.py:function" or class, "module:function", "random"',
    "start": '"file.py:function"',
    "outcomes": "tables `[[outcomes]]`, below",
    "parameters": "tables `[parameters.NAME]`, below",
    "settings": "tables `[settings.NAME]`",
    "options": "a table `[options]`, of the attributes of `stepper.Options`",
    "sensors": 'a file, or tables `[sensors.NAME]` of the attributes of `stepper.Transfer`; "default" is all others',
    "actuators": "a file, or tables `[actuators.NAME]` of the attributes of `stepper.Drive`",
    "trajectories": "in studies in Python alone",
}
"""How values are written in a file that are no numbers, words or lists of them."""
POLICY = (
    "| `policy` | | Only in study files, instead of `controller`: a function of the sensor readings, or a .npz file of `stepper.policies`. "
    'In Python: `controller=stepper.lab.PolicyController(...)`. | "file.py:function", a file |'
)


def attributes(kind):
    """What a docstring says of each attribute, by name, in one line."""
    text = inspect.cleandoc(kind.__doc__).partition("Attributes:\n")[2]
    told = {}
    for name, words in re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", text, re.DOTALL | re.MULTILINE):
        told[name] = " ".join(words.split()).replace("|", "\\|")
    return told


def default(field):
    """The default of a field as it is written in a file; empty of what must be given."""
    value = field.default
    if value is None:
        return "none"
    if value is MISSING or value in ((), ""):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    # As TOML has words and lists of them, which is as JSON does.
    return f"`{json.dumps(value)}`"


def keys(kind):
    """Public fields of a dataclass."""
    return [field for field in fields(kind) if not field.name.startswith("_")]


def table():
    """All keys, as Markdown."""
    lines = []
    for place, kind in PARTS:
        told = attributes(kind)
        if place:
            rows = [f"| `{f.name}` | {default(f)} | {told[f.name]} |" for f in keys(kind)]
            lines += [f"\n`{place}`\n", "| key | default | |", "|---|---|---|", *rows]
        else:
            rows = [f"| `{f.name}` | {default(f)} | {told[f.name]} | {IN_TOML.get(f.name, '')} |" for f in keys(kind)]
            lines += ["| key | default | | in a file |", "|---|---|---|---|", *rows, POLICY]
    return "\n".join(lines).replace("|  |", "| |") + "\n"
