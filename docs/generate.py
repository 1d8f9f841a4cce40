# SPDX-License-Identifier: Apache-2.0
"""The reference pages that are made of the code: `python docs/generate.py` writes them."""

from __future__ import annotations

import argparse
import inspect
import math
import re
from pathlib import Path

import tactile_skin
from tactile_skin import launch, msg
from tactile_skin.cli import COMMANDS, make_parser
from tactile_skin.commands.doctor import BOARD
from tactile_skin.findings.finding import WORDS
from tactile_skin.middleware.bus import Context, DurabilityPolicy, Node, Parameter
from tactile_skin.middleware.package import node_class
from tactile_skin.ros import PARTS

DOCS = Path(__file__).parent
SHOWN = [*PARTS, "push_arrow"]  # nodes whose topics are listed
_MADE = "<!-- made by docs/generate.py -->"
_WIDTH = 80  # characters of a signature on one line
_SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|Yields):$")
_FIELD = re.compile(r"\{(\w+)[^}]*\}")
_EXAMPLES = {"at": "row 2", "line": "row", "across": "column", "bits": "bit 1"}
_EXAMPLES |= {"detail": "...", "settings": "..."}
_ITEM = re.compile(r"^([\w, ]+): (.*)$")


def commands() -> str:
    """Return a page of all commands, their options and examples."""
    parser = make_parser(*COMMANDS)
    (group,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    parts = [
        f"# Commands\n\n{_MADE}\n",
        "`tactile-skin COMMAND --help` prints the same. `name:=value`, `--name value` and "
        "`--name=value` are equal. Completion in your shell: `pip install argcomplete && eval "
        '"$(register-python-argcomplete tactile-skin)"`.\n',
        "| command | what it does |\n|---|---|",
        *(f"| [`{name}`](#{name}) | {text} |" for name, text in COMMANDS.items()),
    ]
    for name, sub in group.choices.items():
        parts.append(f"\n## {name}\n\n{COMMANDS[name][0].upper()}{COMMANDS[name][1:]}.\n")
        options = [a for a in sub._actions if a.help and a.dest != "help"]
        if options:
            parts.append("| argument | |\n|---|---|")
            parts += [f"| {_spelt(a)} | {_help(a)} |" for a in options]
            parts.append("")
        if sub.epilog:
            head, same, _ = sub.epilog.partition(BOARD)  # parameters.md has what follows
            more = f"{same} circuit.* of docs/parameters.md, as rows:=8" if same else ""
            parts.append(f"```text\n{head.rstrip()}\n{more}".rstrip() + "\n```")
    return "\n".join(parts).rstrip() + "\n"


def _spelt(action: argparse.Action) -> str:
    """Return how an argument is written."""
    names = action.option_strings or [action.metavar or action.dest]
    value = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    words = [f"{name} {value}".strip() if action.option_strings else name for name in names]
    return ", ".join(f"`{word}`" for word in words).replace("|", "\\|")


def _help(action: argparse.Action) -> str:
    """Return an argument's help, with its choices if it does not name them."""
    choices = ", ".join(map(str, action.choices or ()))
    words = [str(action.help), *[choices] * (choices not in str(action.help))]
    return "; ".join(words).replace("|", "\\|")


def api() -> str:
    """Return a page of all public names: signature and docstring."""
    parts = [
        f"# Python, every name\n\n{_MADE}\n",
        "Arrays have the shapes that stand in parentheses, quantities the units in brackets. "
        "[Python](python.md) has examples.\n",
    ]
    parts += [_entry(name, getattr(tactile_skin, name)) for name in sorted(tactile_skin.__all__)]
    parts.append("## tactile_skin.launch\n")
    parts += [_entry(name, getattr(launch, name), "###") for name in ("launch", "read_skin")]
    for name, method in (item for kind in launch.Skin.__mro__ for item in vars(kind).items()):
        if inspect.isfunction(method) and not name.startswith("_"):
            parts.append(_entry(f"Skin.{name}", method, "###"))
    parts.append("## tactile_skin.msg\n")
    parts += [_entry(name, getattr(msg, name), "###") for name in ("image_array", "cloud_columns")]
    return "\n".join(parts).rstrip() + "\n"


def _entry(name: str, thing: object, level: str = "##") -> str:
    """Return heading, signature and docstring of a function or class."""
    return f"{level} {name}\n\n```python\n{name}{_signature(thing)}\n```\n\n{_markdown(thing)}\n"


def _signature(thing) -> str:
    """Return the arguments, a long list one a line."""
    found = inspect.signature(thing)
    given = [p for name, p in found.parameters.items() if name != "self"]
    given = [_plain(p.replace(default=_as_list(p.default))) for p in given]
    result = "" if inspect.isclass(thing) else _plain(found).rpartition(")")[2]
    line = f"({', '.join(given)}){result}"
    if len(line) < _WIDTH:
        return line
    return "(\n" + "".join(f"    {p},\n" for p in given) + f"){result}"


def _as_list(default: object) -> object:
    """Return an array as the list that it is written as."""
    return default.tolist() if hasattr(default, "tolist") else default


def _plain(signature) -> str:
    """Return a signature, or a part of it, with annotations and members as they are written."""
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(signature))
    return re.sub(r"<(\w+\.\w+): [^>]*>", r"\1", text).replace("<factory>", "{}").replace("'", '"')


def _markdown(thing: object) -> str:
    """Return a docstring with its sections as lists."""
    lines, section = [], False
    for line in (inspect.getdoc(thing) or "").splitlines():
        head, item = _SECTION.match(line), _ITEM.match(line.strip())
        if head:
            lines += ["", f"**{head[1]}**", ""]
            section = True
        elif section and not line.startswith(" "):
            section = not line
            lines.append(line)
        elif section and item and len(line) - len(line.lstrip()) == 4:
            names = ", ".join(f"`{n}`" for n in item[1].split(", "))
            lines.append(f"- {names}: {item[2]}")
        elif section:
            lines.append(f"    {line.strip()}")
        else:
            lines.append(line)
    text = "\n".join(lines)
    return re.sub(r"\n{3,}", "\n\n", text).strip()


def qos() -> str:
    """Return a page of each topic of a skin's nodes: how it is published, and how it is heard."""
    found: dict[str, tuple[set[str], set[str]]] = {}
    given = [Parameter("port", "loop://"), Parameter("model", "shipped")]
    for kind in SHOWN:
        node = Node(kind, context=Context(), parameter_overrides=given)
        made = node_class(kind)(node)
        for at, ends in enumerate((node._publishers, node._subscriptions)):
            for end in ends:
                found.setdefault(end.topic_name, (set(), set()))[at].add(_profile(end.qos_profile))
        if hasattr(made, "close"):
            made.close()
        node.destroy_node()
    rows = [
        f"| `{name}` | {'; '.join(sorted(there))} | {'; '.join(sorted(heard))} |"
        for name, (there, heard) in sorted(found.items())
    ]
    return (
        f"# Quality of service\n\n{_MADE}\n\n"
        "How the nodes publish each topic, and how they subscribe to it: reliability, durability "
        "and depth, in the root namespace. Latched is transient local. "
        "`qos_overrides` change it ([ROS](robot.md#the-process)).\n\n"
        "| topic | published | subscribed |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )


def _profile(profile) -> str:
    latched = profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    words = [profile.reliability.name.lower().replace("_", " "), *["latched"] * latched]
    limits = {"deadline": profile.deadline, "lifespan": profile.lifespan}
    ends = [f"{name} {value:g} s" for name, value in limits.items() if value < math.inf]
    return ", ".join([*words, str(profile.depth), *ends])


# page: what makes it
def troubleshooting() -> str:
    """Return the page with a table of all that is said of a skin, and what to do, at its end."""
    remedies: dict[str, list[str]] = {}
    for where, evidence, remedy in WORDS.values():
        said = f"{where}: {evidence}" if where else evidence
        if remedy and said != "{detail}":  # else all of it is worked out elsewhere
            remedies.setdefault(_example(said), []).append(_example(remedy))
    rows = [f"| `{said}` | {' Or: '.join(dict.fromkeys(of))} |" for said, of in remedies.items()]
    page = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    head = "| what is said | what to do |\n|---|---|\n"
    return page[: page.index(head)] + head + "\n".join(rows) + "\n"


def _example(template: str) -> str:
    """Return a template with examples of places, and N for each number."""
    return _FIELD.sub(lambda field: _EXAMPLES.get(field[1], "N"), template)


PAGES = {
    "commands.md": commands,
    "api.md": api,
    "qos.md": qos,
    "troubleshooting.md": troubleshooting,
}


if __name__ == "__main__":
    for page, make in PAGES.items():
        (DOCS / page).write_text(make(), encoding="utf-8")
