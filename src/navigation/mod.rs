//! From prompt correlations to navigation data: bits, words, subframes, ephemerides.
