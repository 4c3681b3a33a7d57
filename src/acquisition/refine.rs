//! placeholder
/// r
pub struct Refiner;
/// r
pub struct Refined;
