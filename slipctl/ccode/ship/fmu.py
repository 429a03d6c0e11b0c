"""FMU of a module, for Co-Simulation by FMI 2.0 and 3.0: description, sources, binary, zipped.

The same module gives the same bytes: no date, and a token that is a hash of the content.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence
from functools import partial

from slipctl.ccode.compile import compilers as cc
from slipctl.ccode.compile.files import licence
from slipctl.ccode.compile.platforms import Platform
from slipctl.ccode.compile.programs import scratch_folder
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.header import CONTENT
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship import fmu_xml
from slipctl.ccode.ship.fmu_source import interface
from slipctl.errors import BadInput

VERSIONS = (2, 3)


def fmus(
    plan: Plan, made: Mapping[str, str], content: str, platforms: Sequence[Platform]
) -> dict[str, bytes]:
    """Both FMUs by file name.

    Args:
        plan: the module.
        made: text of its files by name.
        content: hash of header and source.
        platforms: what a binary is made for; without any, tools build the sources.

    Raises:
        BadInput: a step without a period.
        RunFailed: the compiler refuses.
    """
    if not plan.period and plan.block.kind == "step":
        raise BadInput(
            f"{plan.block.name} has no period, which an FMU needs;"
            " write @step(period=0.01, ...), in s"
        )
    now = fmu_xml.is_plant(plan.block)
    own = {n: made[n] for n in plan.files}
    found = {}
    objects: dict[tuple[str, str], bytes] = {}  # the module is compiled once for each
    for version in VERSIONS:
        describe = partial(fmu_xml.description, plan, version, now=now)
        token = _token(describe(token=""), interface(plan, version, "", now), *own.values())
        text = interface(plan, version, token, now).replace(CONTENT, content)
        sources = own | {f"fmi{version}.c": text}
        files = {"modelDescription.xml": describe(token=token).encode()}
        files |= {f"sources/{n}": text.encode() for n, text in sources.items()}
        files["documentation/index.html"] = fmu_xml.page(plan).encode()
        if version == 2:
            files["documentation/LICENSE"] = licence(plan).encode()
        else:
            files["documentation/licenses/license.txt"] = licence(plan).encode()
            files["sources/buildDescription.xml"] = fill_template(
                "buildDescription.xml", n=plan.name
            ).encode()
        for p in (p for p in platforms if version in p.folders):
            name = f"binaries/{p.folders[version]}/{plan.name}{p.suffix}"
            files[name] = _binary(plan, sources, p, objects)
        found[f"{plan.name}_fmi{version}.fmu"] = _zipped(files)
    return found


def _token(*texts: str) -> str:
    """Hash of the content in the form that FMI asks for."""
    h = hashlib.sha256("\0".join(texts).encode()).hexdigest()
    return "{" + "-".join((h[:8], h[8:12], h[12:16], h[16:20], h[20:32])) + "}"


def _binary(
    plan: Plan,
    sources: Mapping[str, str],
    platform: Platform,
    objects: dict[tuple[str, str], bytes],
) -> bytes:
    with scratch_folder(sources) as folder:
        linked = [folder / n.replace(".c", ".o") for n in sources if n.endswith(".c")]
        for o in linked:
            key = platform.name, o.name
            if key in objects:
                o.write_bytes(objects[key])
                continue
            cc.compile_object(
                platform.compiler, o.with_suffix(".c"), o, *platform.compile_flags,
                "-Wno-unused-parameter",
            )  # fmt: skip
            objects[key] = o.read_bytes()
        target = folder / f"{plan.name}{platform.suffix}"
        cc.link(platform.compiler, linked, target, "-shared", *platform.link_flags)
        return target.read_bytes()


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """A zip without dates, in a fixed order."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            entry.create_system = 3
            archive.writestr(entry, files[name])
    return buffer.getvalue()
