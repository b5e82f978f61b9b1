"""Signals over time and their arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from bgdsl.testing.values import OVER_TIME, Series, combine

T = np.linspace(0, 1, 11)


def test_a_cubic_between_the_points() -> None:
    assert Series(T, T**3).at(0.537) == pytest.approx(0.537**3, abs=1e-12)


def test_a_doubled_time_parts_the_curve() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5, 0.6])
    step = Series(time, np.array([0.0, 0, 0, 0, 1, 1, 1, 1]))
    assert [step.at(t) for t in (0.25, 0.3, 0.35)] == [0, 0, 1]


def test_few_points_are_joined_by_lines() -> None:
    assert Series(np.array([0.0, 1.0]), np.array([[0.0, 2.0], [1.0, 4.0]])).at(0.25) == pytest.approx([0.25, 2.5])


def test_times_that_both_cover() -> None:
    result = combine(np.subtract, Series(T, T), Series(np.linspace(0.5, 2, 31), np.linspace(0.5, 2, 31)))
    assert isinstance(result, Series)
    assert result.time[0] == 0.5 and result.time[-1] == 1.0
    assert np.abs(result.values).max() < 1e-12


def test_no_time_in_common() -> None:
    with pytest.raises(ValueError, match="no time in common"):
        combine(np.subtract, Series(T, T), Series(T + 2, T))


def test_a_scalar_signal_meets_an_array_of_as_many_entries_as_there_are_times() -> None:
    time = np.array([0.0, 1.0, 2.0])
    result = combine(np.multiply, Series(time, np.array([1.0, 10.0, 100.0])), np.array([1.0, 2.0, 3.0]))
    assert isinstance(result, Series)
    assert result.values.tolist() == [[1, 2, 3], [10, 20, 30], [100, 200, 300]]


def test_arrays_of_different_lengths() -> None:
    with pytest.raises(ValueError, match="of 2 and of 3"):
        combine(np.add, np.ones(2), Series(T, np.ones((11, 3))))


def test_amplitude_of_each_entry() -> None:
    time = np.linspace(0, 2, 2001)
    signal = Series(time, np.stack([3 * np.sin(2 * np.pi * 5 * time), 1 + np.cos(2 * np.pi * time)], axis=1))
    assert OVER_TIME["amplitude"](signal, 5.0) == pytest.approx([3, 0], abs=1e-3)
