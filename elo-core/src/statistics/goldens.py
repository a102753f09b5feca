"""Prints the numbers that the tests of this folder compare with.

Made with numpy 2.4.6, scipy 1.17.1 and KDEpy 1.1.12:  python goldens.py
"""

import numpy as np
from KDEpy.bw_selection import _fixed_point, _root, improved_sheather_jones
from scipy import stats
from scipy.fft import dct


def two_mode_sample(n):
    """The fixture of `mod.rs`: 85 % near 0.30, 15 % near 0.05, from a 31-bit congruential generator."""
    state = 1

    def uniform():
        nonlocal state
        state = (1103515245 * state + 12345) % 2**31
        return state / 2**31

    sample = []
    for _ in range(n):
        good = uniform() < 0.85
        bell = sum(uniform() for _ in range(12)) - 6.0
        sample.append(0.30 + 0.05 * bell if good else 0.05 + 0.03 * bell)
    return np.array(sample)


def botev(sample, cells=1024):
    """Bandwidth of Botev et al. (2010) on a mesh of twice the range, with KDEpy's equation and root finder."""
    span = np.ptp(sample)
    start, width = sample.min() - span / 2, 2 * span
    position = (sample - start) / (width / cells) - 0.5
    left = np.floor(position).astype(int)
    mass = np.zeros(cells)
    np.add.at(mass, left, 1 - (position - left))
    np.add.at(mass, left + 1, position - left)
    squares = np.arange(1.0, cells) ** 2
    distinct = len(np.unique(sample))
    t = _root(_fixed_point, distinct, (distinct, squares, dct(mass / len(sample))[1:] ** 2))
    return np.sqrt(t) * width


x = two_mode_sample(300)
print("sample", x[:3], x.sum())
print("mean", np.mean(x), "sd", np.std(x), np.std(x, ddof=1), "iqm", stats.trim_mean(x, 0.25))
print("quantiles", np.quantile(x, [0.025, 0.1, 0.5, 0.9, 0.975]))
print("tails", np.mean(x < 0.1), np.mean(x > 0.35))

for successes, trials in [(0, 300), (10, 300), (299, 300), (300, 300), (1, 1), (7, 20), (50_000, 1_000_000)]:
    wilson = stats.binomtest(successes, trials).proportion_ci(0.95, "wilson")
    low = stats.binomtest(successes, trials, alternative="greater").proportion_ci(0.95, "exact").low
    high = stats.binomtest(successes, trials, alternative="less").proportion_ci(0.95, "exact").high
    print("proportion", successes, trials, wilson.low, wilson.high, "exact", low, high)

iqr = np.subtract(*np.quantile(x, [0.75, 0.25]))
sd = np.std(x, ddof=1)
silverman = 0.9 * min(sd, iqr / 1.34) * 300**-0.2
print("silverman", silverman, "scott", stats.gaussian_kde(x, "scott").factor * sd)
kde = stats.gaussian_kde(x, silverman / sd)
points = [0.0, 0.05, 0.1, 0.2, 0.3, 0.45]
print("pdf", kde(points))
print("cdf", [kde.integrate_box_1d(-np.inf, p) for p in points])
# Reflected at 0.02 and 0.4: the wanted density is the sum of the free densities at all mirror images.
inside = x[(x >= 0.02) & (x <= 0.4)]
free = stats.gaussian_kde(inside, 0.05 / np.std(inside, ddof=1))
for p in [0.02, 0.1, 0.3, 0.4]:
    images = [q + 2 * k * 0.38 for k in range(-9, 10) for q in (p, 0.04 - p)]
    cdf = sum(free.integrate_box_1d(0.02 + 2 * k * 0.38, p + 2 * k * 0.38) for k in range(-9, 10))
    cdf += sum(free.integrate_box_1d(0.04 - p + 2 * k * 0.38, 0.02 + 2 * k * 0.38) for k in range(-9, 10))
    print("reflected", p, free(images).sum(), cdf)
# KDEpy 1.1.12 solves for t on a mesh of twice the range (for ranges of 12 and more) but multiplies sqrt(t) by the
# range alone, half of what the method says, hence the factor 2, as its users have reported.
print("isj", botev(x), "KDEpy", 2 * improved_sheather_jones(1000 * x[:, None]) / 1000)
bell = stats.norm.ppf((np.arange(500) + 0.5) / 500)
print("isj bell", botev(bell), "KDEpy", 2 * improved_sheather_jones(1000 * bell[:, None]) / 1000)
print("dct", dct([0.1, 0.2, 0.3, 0.4])[1:] ** 2)
