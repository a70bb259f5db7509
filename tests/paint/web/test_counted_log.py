"""What the server complains of: one line a kind, nothing from outside, and how often at the end."""

import asyncio

import pytest

from hapscene.paint.web.counted_log import KINDS_MAX, CountedLog


def test_each_kind_is_said_once_and_counted_at_the_end(capsys: pytest.CaptureFixture[str]) -> None:
    log = CountedLog()
    for _ in range(3):
        log.logger.warning("malformed message refused")
    log.logger.warning("once")
    log.logger.info("nothing to say")
    said = "hapscene: note: malformed message refused\nhapscene: note: once\n"
    assert capsys.readouterr().err == said
    log.close()
    assert capsys.readouterr().err == "hapscene: note: 3 times: malformed message refused\n"


def test_an_error_is_its_kind_and_place_and_what_it_says_is_not_repeated(capsys: pytest.CaptureFixture[str]) -> None:
    log, loop = CountedLog(), asyncio.new_event_loop()
    loop.set_exception_handler(log.note_loop)

    async def fail() -> None:
        raise ValueError("\x1b[31mfrom outside")

    async def twice() -> None:
        for _ in range(2):
            loop.create_task(fail())
            await asyncio.sleep(0)
        await asyncio.sleep(0)

    loop.run_until_complete(twice())
    loop.close()
    log.logger.error("of %s", "\x1b[31moutside")
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("hapscene: note: Task exception was never retrieved: ValueError in test_counted_log.py:")
    assert second == "hapscene: note: of %s"


def test_there_is_an_end_of_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    log = CountedLog()
    for i in range(1000):
        log.logger.warning(f"kind {i}")
    assert len(capsys.readouterr().err.splitlines()) == len(log.counts) == KINDS_MAX + 1
