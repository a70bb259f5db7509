"""The header line that a probe or a handle sends."""

from hapscene.io.probe_protocol import MAGIC, VERSION, Header, sealed


def header_line(header: Header) -> bytes:
    """Return the header line."""
    columns = ",".join(f"{c.name}:{c.unit}:{c.scale!r}" for c in header.columns)
    return sealed(f"{MAGIC.decode()} {VERSION} rate={header.rate_Hz:.12g} columns={columns}".encode())
