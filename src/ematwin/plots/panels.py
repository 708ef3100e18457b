"""What a figure of a study shows, with its data and words, before anybody draws it.

`ematwin.plots.study` draws it with plotly, where it can be enlarged and asked;
`ematwin.comparison.report.study_svg` draws it still, for a paper or a slim page.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Series:
    """What belongs to one algorithm: its name in the legend and its colour."""

    name: str
    color: str


@dataclass(frozen=True)
class Bars(Series):
    """A bar with a whisker in each category of the panel.

    Attributes
    ----------
    height, low, high : (C,) arrays, NaN where there is no run
    """

    height: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Spread(Series):
    """A line with a band around it.

    Attributes
    ----------
    x, middle, low, high : (G,) arrays
    """

    x: np.ndarray
    middle: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Box(Series):
    """A box in one category of the panel, with whiskers to the extremes.

    Attributes
    ----------
    place : int, of the category
    quantiles : (5,) array: least, lower quartile, median, upper quartile, largest
    points : array, values to draw one by one; empty where they are many
    """

    place: int
    quantiles: np.ndarray
    points: np.ndarray


@dataclass(frozen=True)
class Stairs(Series):
    """A line that keeps its height until the next point.

    Attributes
    ----------
    x, y : (G,) arrays
    """

    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Panel:
    """A pair of axes; ``categories`` name the places of a horizontal axis without numbers."""

    title: str
    series: list[Bars | Spread | Box | Stairs]
    categories: tuple[str, ...] = ()


@dataclass(frozen=True)
class Figure:
    """One panel, or a grid of them with the same axes.

    Attributes
    ----------
    file : str, name of the still drawing
    heading : str
    panels : list of Panel
    grid : bool, two panels in a row
    y_title, x_title : str
    log_x, log_y : bool
    y_range : pair of float, or None where the data decide
    """

    file: str
    heading: str
    panels: list[Panel]
    grid: bool = False
    y_title: str = ""
    x_title: str = ""
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None
