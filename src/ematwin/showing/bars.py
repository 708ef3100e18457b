"""A progress bar: of rich in a terminal, of HTML in a notebook.

Bars of rich and tqdm need ipywidgets in a notebook; a piece of HTML that is shown anew does not.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from html import escape
from typing import Any

Bar = Callable[..., None]  # takes the share done, in [0, 1], and a few words


def no_bar(share: float, words: str = "") -> None:
    """Show nothing."""


def bar(title: str) -> AbstractContextManager[Bar]:
    """A bar that goes when the work is done; nothing where there is no terminal or notebook."""
    return _in_notebook(title) if in_notebook() else in_terminal(title)


@contextmanager
def told(
    progress: Callable[..., None] | bool | None,
    title: str,
    shown: Callable[..., tuple[Any, ...]] = lambda share: (share,),
) -> Iterator[Any]:
    """Give the function that takes the progress: the given one, a bar for True, else None.

    ``shown`` turns a report into the share done, and words beside it if there are any.
    """
    if progress is True:
        with bar(title) as show:
            yield lambda *reported: show(*shown(*reported))
    else:
        yield progress or None


def in_notebook() -> bool:
    """Whether this runs in a notebook, or another front end that shows HTML."""
    if "IPython" not in sys.modules:
        return False
    from IPython import get_ipython

    shell = get_ipython()
    return shell is not None and hasattr(shell, "kernel")


@contextmanager
def _in_notebook(title: str) -> Iterator[Bar]:
    from IPython.display import HTML, display

    def picture(share: float, words: str) -> HTML:
        share = min(max(share, 0.0), 1.0)
        filled = f'<progress max="1" value="{share:.3f}"></progress>'
        return HTML(f"<div>{escape(title)} {filled} {100.0 * share:.0f} % {escape(words)}</div>")

    shown: Any = display(picture(0.0, ""), display_id=True)
    last = 0.0

    def update(share: float, words: str = "") -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= 0.1:  # s between two pictures
            last = now
            shown.update(picture(share, words))

    try:
        yield update
    finally:
        shown.update(HTML(""))


@contextmanager
def in_terminal(title: str) -> Iterator[Bar]:
    """Show a bar with words and the time left on standard error, if that is a terminal."""
    if not sys.stderr.isatty():
        yield no_bar
        return
    from rich.console import Console
    from rich.markup import escape as plain
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Left

    before, behind = TextColumn("{task.description}"), TextColumn("{task.fields[words]}")
    columns = (before, BarColumn(), TaskProgressColumn(), behind, Left())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, speed_estimate_period=600.0) as shown:
        task = shown.add_task(plain(title), total=1.0, words="")
        yield lambda share, words="": shown.update(task, completed=share, words=words)
