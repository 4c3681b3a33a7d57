//! Scenarios: captures made from first principles, with known truth.
