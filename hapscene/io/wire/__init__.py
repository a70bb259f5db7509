"""Serial communication with boards: probes for recordings, and actuated handles.

| module | content |
|---|---|
| `port` | serial port that is read by a thread |
| `protocol` | line protocol of docs/reference/probe-protocol.md, which docs/reference/handle-protocol.md extends |
| `unit` | units of recorded quantities |
"""
