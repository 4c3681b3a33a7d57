//! The experiment of Khodabandeh & Teunissen, "Distributed least-squares estimation applied to GNSS networks"
//! (Meas. Sci. Technol. 30 (2019) 044005), on a made network of the same size.

pub mod scene;
