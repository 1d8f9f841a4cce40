"""A simulated board in a thread of the test, on a real pseudo-terminal."""

import contextlib
import threading

from tactile_skin import Circuit, PressureCurve, board, scenes

PATIENCE = 30.0  # s, for what must happen; how fast it does is not tested
CIRCUIT = Circuit(4, 5)  # small frames: little to compute


def make_board(scene="idle", circuit=CIRCUIT, **kwargs) -> board.Board:
    return board.Board(circuit, PressureCurve(), scenes.script(scene, *circuit.shape), **kwargs)


class Serving:
    """The board behind the link, until `unplug`."""

    def __init__(self, link, simulated=None):
        self._tick = threading.Semaphore(0)
        self._done = threading.Event()
        args = (simulated or make_board(), link, self._running)
        self._thread = threading.Thread(target=board.serve, args=args)
        self._thread.start()
        self.let_it_notice()

    def _running(self) -> bool:
        self._tick.release()  # once for each turn of the board's loop
        return not self._done.is_set()

    def let_it_notice(self) -> None:
        """Until the board has looked at its port twice: it polls whether somebody opened it."""
        while self._tick.acquire(blocking=False):
            pass
        for _ in range(3):
            assert self._tick.acquire(timeout=PATIENCE)

    def unplug(self) -> None:
        self._done.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@contextlib.contextmanager
def serving(link, simulated=None):
    served = Serving(link, simulated)
    try:
        yield served
    finally:
        served.unplug()
