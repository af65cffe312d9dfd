"""A link that is slow and loses packets, as TCP shows it: what it carries comes late, in order.

The kernels that tests run on need not know how to delay packets, so a relay does.
"""

import asyncio
import random
import threading
from contextlib import suppress
from typing import Self

_CHUNK = 1400  # bytes: a packet's
_RETRANSMITTED_S = 0.3  # a packet that was lost comes that much later, and what is behind it too


class SlowLink:
    """Listens at a port of loopback inside a ``with``, and passes on what comes to another.

    Attributes:
        delay_s: of what goes either way, from now on.
        loss: the share of packets that are lost, from now on.
    """

    def __init__(self, port: int, target: int) -> None:
        self.delay_s = 0.0
        self.loss = 0.0
        self.lost = 0
        self._port = port
        self._target = target
        self._random = random.Random(5)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)

    def __enter__(self) -> Self:
        self._thread.start()
        opening = asyncio.start_server(self._connect, "127.0.0.1", self._port)
        asyncio.run_coroutine_threadsafe(opening, self._loop).result(10)
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(_cancel_all(), self._loop).result(10)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._target)
        with suppress(ConnectionError):
            await asyncio.gather(self._carry(reader, back), self._carry(there, writer))

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        arriving = asyncio.create_task(self._arrive(under_way, writer))
        due = 0.0
        while packet := await reader.read(_CHUNK):
            due = max(due, self._loop.time() + self.delay_s + self._retransmission())
            under_way.put_nowait((due, packet))
        under_way.put_nowait((due, b""))
        await arriving

    def _retransmission(self) -> float:
        is_lost = self._random.random() < self.loss
        self.lost += is_lost
        return _RETRANSMITTED_S * is_lost

    async def _arrive(
        self, under_way: "asyncio.Queue[tuple[float, bytes]]", writer: asyncio.StreamWriter
    ) -> None:
        while True:
            due, packet = await under_way.get()
            await asyncio.sleep(max(0.0, due - self._loop.time()))
            if not packet:
                writer.close()
                return
            writer.write(packet)
            await writer.drain()


async def _cancel_all() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
