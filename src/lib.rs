//! **sdr-rx**, a GNSS software receiver: from samples of one antenna or of an antenna array to acquisition, tracking,
//! navigation messages, observations and positions.
//!
//! # The modules, in the order of the data path
//!
//! Each stage is a function from one plain type to the next.
//!
//! **[`scenario`]** simulates: a TOML file becomes a source of samples with known truth, from orbits, clocks,
//! atmosphere, navigation message, noise, jammers and a replaceable front end.
//!
//! **[`capture`]** reads files and pipes (raw types, packed bits, SigMF, ION metadata, WAV) as a
//! [`SampleSource`](capture::SampleSource) of [`Block`](capture::Block)s: channels x samples, planar
//! `Complex<f32>`. Memory does not grow with the length of a file.
//!
//! **[`front_end`]** suppresses impulsive noise by the distribution of the samples, removes the intermediate
//! frequency, lowers the rate, and measures level and spectrum.
//!
//! **[`array`](mod@array)** processes the channels of an antenna array: jammers located and removed, a signature and
//! a beam for each satellite, and a test for spoofing. Before any code is searched, it finds number and directions of
//! the sources in the covariance by LDA-l1,1 (Lagrangian dual ascent for the sparse problem with two l1,1 norms) and
//! JANE (joint angle and number estimation).
//!
//! **[`acquisition`]**: a [`SearchPlan`](acquisition::SearchPlan) searches all code phases and Dopplers with a given
//! false-alarm probability ([`array::code_periods`] finds most signals from a few singular vectors instead); a
//! [`Refiner`](acquisition::Refiner) measures what was found to the Cramer-Rao bound. Mirrored spectra and missing
//! samples are detected.
//!
//! **[`tracking`]** on **[`correlator`]**: a [`Channel`](tracking::Channel) tracks one satellite with phase,
//! frequency and code loops; it gives an [`Epoch`](tracking::Epoch) for each code period and the
//! [`Symbol`](tracking::Symbol)s of the message.
//!
//! **[`receiver`]** runs these stages: [`Receiver::push`](receiver::Receiver::push) takes samples and reports
//! [`Event`](receiver::Event)s (satellites, messages, observations, positions), of which a
//! [`Recorder`](receiver::Recorder) makes the record of a run. **[`advice`]** finds the probable mistake in the
//! options when almost nothing was acquired.
//!
//! **[`report`]** writes the record: tables, JSON, RINEX, NMEA 0183, GeoJSON, KML, plots.
//!
//! **[`experiment`]** sweeps the properties of a front end and compares the losses with theory.
//!
//! # The crates
//!
//! **[`gnss`]**: signals, messages, orbits, observations, antennas, time, coordinates, and files of them.
//!
//! **[`position`]**: positions from observations without prior knowledge, by pseudoranges, Dopplers or both, for
//! epochs and for snapshots of unknown time; a [`Solver`](position::solver::Solver) for research.
//!
//! **[`network`]**: least squares in a network of receivers without a centre, as state machines for any transport.
//!
//! # From a scenario to a position
//!
//! A snapshot of a tenth of a second over Munich, with known orbits and a time that is wrong by half a minute:
//!
//! ```
//! use sdr_rx::acquisition::{Refiner, SearchOptions, SearchPlan};
//! use sdr_rx::capture::{Block, SampleSource};
//! use sdr_rx::correlator::{CodeTable, SampleBuffer};
//! use sdr_rx::acquisition::snapshot_epoch;
//! use sdr_rx::position::{PositioningOptions, solve_snapshot};
//! use sdr_rx::scenario::{Scenario, ScenarioSource};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
//! let scenario = Scenario::read("signals/static_8sv.toml".as_ref())?;
//! let mut source = ScenarioSource::new(&scenario)?;
//! let rate_hz = source.info().rate_hz;
//! let mut block = Block::default();
//! let samples = source.read(&mut block, (0.1 * rate_hz) as usize)? as u64;
//!
//! let found = SearchPlan::new(rate_hz, SearchOptions::default())?.search(block.channel(0))?;
//! let mut buffer = SampleBuffer::default();
//! buffer.push(block.channel(0));
//! let refiner = Refiner::new(&buffer, rate_hz, 0, samples);
//! let refined: Vec<_> = found
//!     .iter()
//!     .filter_map(|a| refiner.refine(a, &CodeTable::new(a.transmission, rate_hz), 100.0))
//!     .collect();
//!
//! let epoch = snapshot_epoch(&refined, scenario.start + 30.0, samples, rate_hz);
//! let fix = solve_snapshot(&epoch, &scenario.navigation()?, &PositioningOptions::default())?;
//!
//! // Thermal noise of 100 ms at 45 dB-Hz makes some 4 m of range; the dilution of precision is 1.7.
//! let error_m = (fix.position_m - scenario.receiver.position.ecef()).norm();
//! assert!(error_m < 50.0 && (fix.time - scenario.start).abs() < 0.2);
//! # Ok(())
//! # }
//! ```

pub use sdr_rx_gnss as gnss;
pub use sdr_rx_network as network;
pub use sdr_rx_position as position;

pub mod acquisition;
pub mod advice;
pub mod array;
pub mod capture;
pub mod correlator;
pub mod experiment;
pub mod front_end;
pub mod receiver;
pub mod report;
pub mod scenario;
pub mod temporary;
pub mod tracking;
