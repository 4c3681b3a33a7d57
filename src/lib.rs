//! **sdr-rx**: samples of an antenna array go in at the top of the house, and a position with
//! everything a person needs to trust it comes out at the bottom.

pub mod acquisition;
pub mod advice;
pub mod capture;
pub mod correlator;
pub mod front_end;
pub mod gnss;
pub mod navigation;
pub mod observables;
pub mod positioning;
pub mod receiver;
pub mod report;
pub mod scenario;
pub mod temporary;
pub mod tracking;
