"""The serial line between a computer and a board: a probe that is recorded, or a handle that is driven.

| module | does |
|---|---|
| `port` | drains a serial port by a thread of its own |
| `protocol` | the lines of docs/probe-protocol.md, which docs/handle-protocol.md adds to |
| `unit` | units of what is recorded |
"""
