"""The line protocol of probes."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.errors import CaptureError
from hapscene.io.probe_protocol import (
    WRAP,
    Column,
    Decoder,
    Header,
    sample_line,
    sealed,
)
from tests.header_line import header_line

HEADER = Header(1000.0, (Column("acceleration", "m/s2", 0.001), Column("force", "N", 0.01)))
DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "reference" / "probe-protocol.md"


def row(n: int) -> tuple[int, int]:
    return (n * 7) % 4001 - 2000, n % 300


def lines(numbers: range) -> list[bytes]:
    return [sample_line(n, row(n)) for n in numbers]


def decode(parts: list[bytes], rate_Hz: float = 1000.0) -> tuple[Decoder, dict[int, list[int]]]:
    """Feed the header, then a part every 1/rate; return the samples by position."""
    decoder = Decoder()
    came: dict[int, list[int]] = {}
    for k, part in enumerate([header_line(HEADER), *parts]):
        for run in decoder.feed(part, k / rate_Hz):
            for i, counts in enumerate(run.counts.tolist()):
                assert run.first + i not in came
                came[run.first + i] = counts
    return decoder, came


def test_example_in_the_docs() -> None:
    example = re.search(r"(    #hapscene-probe.*\n(?:    \d.*\n)+)", DOCUMENT.read_text(encoding="utf-8"))
    assert example is not None
    text = b"".join(line.strip().encode() + b"\n" for line in example[1].splitlines())
    decoder = Decoder()
    (run,) = decoder.feed(text, 0.0)
    assert decoder.header is not None and decoder.header.rate_Hz == 3200.0
    assert run.counts.tolist() == [[-812, 1204], [-797, 1204], [-641, 1205]]
    assert decoder.count.torn == decoder.count.garbage == decoder.count.dropped == 0


@pytest.mark.parametrize("size", [1, 17, 5000])
def test_chunks_of_any_size(size: int) -> None:
    text = b"".join(lines(range(300)))
    decoder, came = decode([text[i : i + size] for i in range(0, len(text), size)])
    assert came == {n: list(row(n)) for n in range(300)}
    assert decoder.count.received == 300 and decoder.count.dropped == 0


def test_dropped_samples_leave_a_gap() -> None:
    sent = lines(range(200))
    for n in (5, 6, 7, 100):
        sent[n] = b""
    decoder, came = decode(sent)
    assert came == {n: list(row(n)) for n in range(200) if n not in (5, 6, 7, 100)}
    assert decoder.count.dropped == 4 and decoder.count.torn == decoder.count.garbage == 0


def test_damaged_lines_are_counted() -> None:
    sent = lines(range(50))
    sent[10] = sent[10][:5] + b"\n"  # cut
    sent[20] = sent[20][:6]  # joined with the next line
    sent[30] = sent[30].replace(b",", b",1", 1)  # a digit too many
    sent[40] = b"\x00\xff\x80garbage\n" + sent[40]
    sent[45] = b"boot: ok\r\n" + sent[45].replace(b"\n", b"\r\n")
    sent.append(sealed(b"50,1"))  # intact, but from another probe
    decoder, came = decode(sent)
    assert set(came) == set(range(50)) - {10, 20, 21, 30}
    assert all(came[n] == list(row(n)) for n in came)
    assert decoder.count.dropped == 4 and decoder.count.torn == 4 and decoder.count.garbage == 2


def test_numbers_wrap() -> None:
    sent = lines(range(WRAP - 50, WRAP + 50))
    sent[60] = b""
    decoder, came = decode(sent)
    assert sorted(came) == [n for n in range(100) if n != 60] and decoder.count.dropped == 1


def test_long_gap_is_measured_by_the_clock() -> None:
    decoder = Decoder()
    decoder.feed(header_line(HEADER) + sample_line(0, (1, 1)), 0.0)
    later = 2 * WRAP + 10
    (run,) = decoder.feed(sample_line(later, (2, 2)), later / 1000.0 + 0.3)
    assert run.first == later and decoder.count.dropped == later - 1 and decoder.count.restarts == 0


def test_restarted_probe() -> None:
    decoder = Decoder()
    decoder.feed(header_line(HEADER) + b"".join(lines(range(100))), 0.1)
    (run,) = decoder.feed(header_line(HEADER) + sample_line(0, (1, 1)), 2.1)
    assert run.first == 99 + 2000 and decoder.count.restarts == 1


def test_data_before_the_header_is_ignored() -> None:
    decoder = Decoder()
    assert decoder.feed(b"-12*00\nbooting\n" + sample_line(7, (1, 1)), 0.0) == []
    (run,) = decoder.feed(header_line(HEADER) + sample_line(8, (2, 3)), 0.1)
    assert (run.first, run.counts.tolist()) == (0, [[2, 3]])
    assert decoder.count.torn == decoder.count.garbage == decoder.count.dropped == 0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"#hapscene-probe 2 speed=fast", "version 2"),
        (b"#hapscene-probe 1 columns=a:g:1", "rate=HZ"),
        (b"#hapscene-probe 1 rate=1000 columns=a:g", "NAME:UNIT:SCALE"),
        (b"#hapscene-probe 1 rate=1000 columns=a:g:0", "NAME:UNIT:SCALE"),
        (b"#hapscene-probe 1 rate=1000 columns=a:g:1,a:g:1", "distinct"),
        (b"#hapscene-probe 1 rate=1000 columns=" + b",".join(b"a%d:g:1" % i for i in range(17)), "16"),
    ],
)
def test_invalid_header_raises(line: bytes, message: str) -> None:
    with pytest.raises(CaptureError, match=message):
        Decoder().feed(sealed(line), 0.0)


def test_changed_header_raises() -> None:
    decoder = Decoder()
    decoder.feed(header_line(HEADER) + b"#hapscene-probe 1 rate=50*0000\n", 0.0)
    assert decoder.count.torn == 1
    with pytest.raises(CaptureError, match="another rate"):
        decoder.feed(header_line(Header(2000.0, HEADER.columns)), 1.0)


def test_too_long_line_is_discarded() -> None:
    decoder = Decoder(HEADER)
    for k in range(100):
        decoder.feed(b"x" * 1000, k * 1e-3)
    assert len(decoder._rest) <= 512 and decoder.count.garbage > 50


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=2000), st.integers(1, 300))
def test_samples_after_noise_are_decoded(noise: bytes, size: int) -> None:
    """Intact lines after a line end are decoded, also after damaged data."""
    decoder = Decoder(HEADER)
    decoder.feed(sample_line(0, row(0)), 0.0)
    for i in range(0, len(noise), size):
        decoder.feed(noise[i : i + size], 0.0)
    runs = decoder.feed(b"\n" + b"".join(lines(range(1, 50))), 0.05)
    assert [r.first for r in runs] == [1] and runs[0].counts.tolist() == [list(row(n)) for n in range(1, 50)]
