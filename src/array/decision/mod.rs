//! How many sources there are, and where: JANE, the row rule, and the distributions under noise alone.

pub mod jane;
mod jane_cov;
pub mod random_matrix;
mod robust_fit;
pub mod row_rule;
pub mod scan;

pub use jane::{Decision, Jane, JaneError, JaneOptions, Source};
pub use row_rule::{Group, row_noise, row_rule};
