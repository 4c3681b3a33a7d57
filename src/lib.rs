//! **sdr-rx**: samples of an antenna array go in at the top of the house, and a position with
//! everything a person needs to trust it comes out at the bottom.
//!
//! # The tour, in the order of the data path
//!
//! Every stage is a function from one plain type to the next.
//!
//! **[`scenario`]**: a TOML file becomes a source of samples with known truth: orbits, light time, Earth
//! rotation, clocks, atmosphere, navigation message, noise, and a front end that can be swapped.
//!
//! **[`capture`]**: files and pipes become a [`SampleSource`](capture::SampleSource), which gives a
//! [`Block`](capture::Block): channels x samples, planar `Complex<f32>`. Raw types, packed bits, SigMF, ION
//! metadata and WAV are told apart; memory does not grow with the length of a file.
//!
//! **[`front_end`]**: impulses are suppressed by the distribution that the samples show, the intermediate frequency is
//! removed, the rate lowered, level and spectrum measured.
//!
//! **[`array`](mod@array)**: the channels of an antenna array: jammers located and removed, sources counted and located
//! by LDA-l1,1 and JANE before any code is known, the signature of each satellite, a beam to it, and the test
//! that names signals which all come from one direction.
//!
//! **[`acquisition`]**: [`SearchPlan`](acquisition::SearchPlan) looks at every code phase and Doppler with a
//! chosen false-alarm probability; [`search_code_periods`](array::code_periods::search_code_periods) finds most of
//! them in a few singular vectors instead; [`Refiner`](acquisition::Refiner) measures what was found to the
//! Cramer-Rao bound; the set of satellites tells mirrored spectra and missing samples.
//!
//! **[`tracking`]** on **[`correlator`]**: a [`Channel`](tracking::Channel) follows one satellite with phase,
//! frequency and code loops, one [`Epoch`](tracking::Epoch) per code period, one [`Bit`](tracking::Bit)
//! per twenty, and says when it has lost it.
//!
//! **[`gnss::message`]**: bits become subframes (parity, polarity, time of week), subframes ephemerides,
//! ionosphere and UTC, accepted only when their issue numbers agree.
//!
//! **[`gnss::observation`]**: tracks at one instant, or a snapshot's code phases, become
//! [`Observation`](gnss::observation::Observation)s: pseudorange, Doppler, carrier phase, C/N0.
//!
//! **[`position`]**: a [`Solver`](position::Solver) leads from the Earth's centre to the region by
//! pseudoranges, Dopplers or both; then the full model, a residual test with exclusion, velocity, covariance.
//! A snapshot needs neither place nor time. It knows of no files and no samples.
//!
//! **[`network`]**: many receivers' [`LinearModel`](network::LinearModel)s become one solution at each of them,
//! without a centre: a [`Station`](network::station::Station) is a state machine that any transport may carry.
//! **[`network::file`]** reads networks.
//!
//! **[`report`]**: RINEX, NMEA 0183, GeoJSON, KML, JSON, a page with plots, tables on the terminal.
//!
//! **[`experiment`]**: figures of papers made again, with a verdict for each claim; sweeps over front ends.
//!
//! **[`gnss`]** lies beneath all floors: constants, time, coordinates, orbits, codes, navigation files.
//! **[`receiver`]** wires the stages in this order and holds nothing else; **[`advice`]** names a
//! newcomer's likely mistake when nothing is found.
//!
//! # From a scenario to a position
//!
//! A tenth of a second over Munich, the orbits known, the time told wrong by half a minute:
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
