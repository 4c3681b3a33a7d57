//! Reports read by other programs.

fn main() {}
