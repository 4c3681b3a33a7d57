//! Following a satellite: carrier and code loops from the first sample to the last.
