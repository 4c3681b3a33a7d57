//! The start of a stream: gathered, searched and refined.

use super::event::{Event, Notice};
use super::find::{BeamFormer, Channels, Found, Region, search};
use super::judge::is_common_noise;
use super::sky::see;
use super::stages::Stages;
use super::survey::{LONG_S, survey};
use super::{Emit, ReceiverError, ReceiverOptions};
use crate::acquisition::{
    Acquisition, AcquisitionError, Refined, SearchOptions, common_code_offset,
    find_missing_samples, is_mirrored,
};
use crate::array::sky::interference::Interference;
use crate::array::{ArraySky, Manifold};
use crate::capture::Block;
use crate::correlator::{Depth, SampleBuffer};
use crate::gnss::constants::WGS84_A;
use crate::gnss::{Constellation, Sv, Transmission};

/// Maximum number of samples of a head: of one channel, and of all together.
const HEAD_SAMPLES: f64 = 8e6;
const HEAD_SAMPLES_OF_ALL: f64 = 24e6;

/// The start of a stream, for acquisition.
pub(super) struct Head {
    pub(super) block: Block,
    /// The same samples in buffers of correlators, by channel.
    pub(super) buffers: Vec<SampleBuffer>,
    /// Whether the elements have common noise, so that only one of them can be searched.
    pub(super) common_noise: bool,
}

impl Head {
    /// Keeps the first `samples` of each channel.
    pub(super) fn truncate(&mut self, samples: usize) {
        self.block.truncate(samples.max(1));
    }
}

/// A head that is being gathered.
pub(super) struct Gathering {
    want: usize,
    /// The stages as they were before the first block, but for the removal of jammers.
    plain: Stages,
    /// Of an array the untreated samples, in case the removal of jammers was wrong.
    raws: Vec<Block>,
    blocks: Vec<Block>,
    depths: Vec<Depth>,
    len: usize,
}

impl Gathering {
    /// For a head of so many seconds.
    pub(super) fn new(seconds: f64, stages: &Stages) -> Self {
        let most = HEAD_SAMPLES.min(HEAD_SAMPLES_OF_ALL / stages.info().channels as f64);
        Self {
            want: (seconds * stages.rate_hz()).min(most) as usize,
            plain: stages.without_spatial(),
            raws: Vec::new(),
            blocks: Vec::new(),
            depths: Vec::new(),
            len: 0,
        }
    }

    /// Takes the next chunk of samples; whether that is enough.
    pub(super) fn take(&mut self, raw: &mut Block, stages: &mut Stages, last: bool) -> bool {
        let mut block = Block::default();
        if raw.channels() > 1 {
            self.raws.push(raw.clone());
        }
        stages.treat(raw, &mut block, last);
        self.len += block.len();
        self.blocks.push(block);
        self.depths.push(stages.depth());
        self.len >= self.want
    }

    /// The head. Where what was removed as a jammer is common noise of the elements, it is no longer removed, in
    /// later samples neither.
    pub(super) fn finish(mut self, stages: &mut Stages, asked: &SearchOptions) -> Head {
        let mut common_noise = false;
        if stages.interference().is_some() {
            let mut plain = self.plain;
            let treated = |raw: &mut Block| {
                let mut block = Block::default();
                plain.treat(raw, &mut block, false);
                block
            };
            let untouched: Vec<Block> = self.raws.iter_mut().map(treated).collect();
            common_noise = is_common_noise(&untouched[0], &self.blocks[0], stages.rate_hz(), asked);
            if common_noise {
                self.blocks = untouched;
                *stages = plain;
            }
        }
        let mut buffers = vec![SampleBuffer::default(); stages.info().channels];
        for (block, &depth) in self.blocks.iter().zip(&self.depths) {
            for (c, buffer) in buffers.iter_mut().enumerate() {
                buffer.push_at(block.channel(c), depth);
            }
        }
        Head { block: Block::joined(&self.blocks), buffers, common_noise }
    }
}

/// With fewer satellites than this a deeper search follows, and where their median C/N0 is below this: the first search
/// then misses others, one in ten at 35 dB-Hz (docs/acquisition.md).
const ENOUGH_SATELLITES: usize = 8;
const ENOUGH_DBHZ: f64 = 36.0;

/// Signal that a mirrored spectrum is looked for in, s.
const MIRROR_S: f64 = 0.1;

/// With fewer sound satellites than this, Dopplers are searched so much farther either way: 10 ppm of the carrier.
const FEW_SATELLITES: usize = 4;
const SOUND_DBHZ: f64 = 30.0;
const WIDE_HZ: f64 = 16e3;
/// Dopplers searched over more than this are those of low orbits, of which more satellites can be in view.
const LOW_ORBIT_HZ: f64 = 40e3;
/// Where a sound satellite is this near an end of the interval, the others are searched beyond it.
const NEAR_END_HZ: f64 = 700.0;
const BEYOND_HZ: f64 = 5e3;

/// Standard deviations from which a common offset of the codes against the carriers is believed, and steps by which it
/// is approached.
const SIGNIFICANT: f64 = 5.0;
const CODE_OFFSET_STEPS: usize = 4;

/// Results of the head.
pub(super) struct HeadFound {
    pub(super) found: Vec<Found>,
    /// With an array.
    pub(super) sky: Option<ArraySky>,
    /// By which fraction codes run faster than their carriers say.
    pub(super) code_offset: f64,
    /// The Doppler interval in which satellites are.
    pub(super) doppler_hz: (f64, f64),
}

fn median_dbhz(cells: &[Acquisition]) -> f64 {
    let mut all: Vec<f64> = cells.iter().map(|c| c.cn0_dbhz).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}

fn refined(found: &[Found]) -> Vec<Refined> {
    found.iter().map(|f| f.refined).collect()
}

/// Searches the head, deeper where little is found, and refines over its first `refine` samples.
pub(super) fn acquire_head(
    head: &Head,
    rate_hz: f64,
    options: &ReceiverOptions,
    refine: u64,
    interference: Option<&Interference>,
    emit: &mut Emit,
) -> Result<HeadFound, ReceiverError> {
    let whole_ms = (head.block.len() as f64 / rate_hz * 1e3 + 1e-6).floor() as usize;
    let mut asked = options.search.clone();
    asked.coherent_ms = asked.coherent_ms.min(whole_ms).max(1);
    let mut surveyed = None;
    let searched = if head.common_noise { 1 } else { head.block.channels() };
    let manifold = options.array.as_ref().filter(|_| searched > 1);
    let manifold = manifold.map(|array| Manifold::new(array.in_enu()));
    let mut used = Channels::new(searched, interference, manifold.as_ref());
    if searched > 1 {
        let survey = survey(&head.block, rate_hz, LONG_S, interference, options)?;
        let is_left = |t: &Transmission| survey.cells.iter().all(|c| c.transmission != *t);
        asked.satellites.retain(|t| options.searches_rest && is_left(t));
        surveyed = Some(survey);
    }
    let known: Vec<Acquisition> = surveyed.iter().flat_map(|s| s.cells.clone()).collect();
    type Cells = Result<Vec<Acquisition>, AcquisitionError>;
    let search_rest = |asked: &SearchOptions, used: Channels<'_>| -> Cells {
        let mut cells = known.clone();
        if !asked.satellites.is_empty() {
            cells.extend(search(&head.block, rate_hz, asked, used, &known)?);
        }
        Ok(cells)
    };
    let mut cells = search_rest(&asked, used)?;
    // An oscillator that is some ppm off shifts all Dopplers alike: few satellites, or all near one end.
    let sound = |cells: &[Acquisition]| cells.iter().filter(|c| c.cn0_dbhz > SOUND_DBHZ).count();
    let (low, high) = asked.doppler_hz;
    if sound(&cells) < FEW_SATELLITES && high - low < 2.0 * WIDE_HZ {
        let wide = SearchOptions { doppler_hz: (low - WIDE_HZ, high + WIDE_HZ), ..asked.clone() };
        let all = search_rest(&wide, used)?;
        if sound(&all) > sound(&cells) {
            let mut dopplers: Vec<f64> =
                all.iter().filter(|c| c.cn0_dbhz > SOUND_DBHZ).map(|c| c.doppler_hz).collect();
            dopplers.sort_by(f64::total_cmp);
            let middle = dopplers[dopplers.len() / 2];
            asked.doppler_hz = (low + middle, high + middle);
            emit(Event::Notice(Notice::Oscillator { offset_hz: middle }));
            cells = search_rest(&asked, used)?;
        }
    }
    // One at an end: others are beyond it.
    let (low, high) = asked.doppler_hz;
    for (end, beyond) in [(high, (high, high + BEYOND_HZ)), (low, (low - BEYOND_HZ, low))] {
        let is_near =
            |c: &Acquisition| c.cn0_dbhz > SOUND_DBHZ && (c.doppler_hz - end).abs() < NEAR_END_HZ;
        let is_new =
            |t: &Transmission, cells: &[Acquisition]| cells.iter().all(|c| c.transmission != *t);
        let mut rest = SearchOptions { doppler_hz: beyond, ..asked.clone() };
        rest.satellites.retain(|t| is_new(t, &cells));
        if high - low > 2.0 * WIDE_HZ || rest.satellites.is_empty() || !cells.iter().any(is_near) {
            continue;
        }
        let mut more = search(&head.block, rate_hz, &rest, used, &cells)?;
        more.retain(|c| c.cn0_dbhz > SOUND_DBHZ && is_new(&c.transmission, &cells));
        if !more.is_empty() {
            let (low, high) = asked.doppler_hz;
            asked.doppler_hz = (low.min(beyond.0), high.max(beyond.1));
            cells.extend(more);
        }
    }
    let deep = asked.max_windows.max(deep_windows(searched));
    let deeper = deep > asked.max_windows && whole_ms > asked.coherent_ms * asked.max_windows;
    let is_complete = surveyed.as_ref().is_some_and(|s| s.is_complete);
    let is_enough = cells.len() >= ENOUGH_SATELLITES && median_dbhz(&cells) >= ENOUGH_DBHZ;
    if !is_enough && deeper && !is_complete {
        asked.max_windows = deep;
        used.most = searched;
        cells = search_rest(&asked, used)?;
    }
    let beams = &BeamFormer::new(options.beams, &head.block);
    let (block, buffers) = (&head.block, &head.buffers[..]);
    let region = |end: u64, code_offset: f64| Region {
        block,
        buffers,
        beams,
        rate_hz,
        start: 0,
        end,
        code_offset,
    };
    // In 0.1 s even the code of a mirrored satellite stays within a chip of its expected phase.
    let short = refine.min((MIRROR_S * rate_hz) as u64);
    let mut found = region(short, 0.0).refine_all(&cells, &asked);
    let mut code_offset = 0.0;
    if is_mirrored(&refined(&found)) {
        emit(Event::Notice(Notice::Mirrored));
    } else {
        let mut end = refine;
        // A code that drifts out of its replica shows less of its drift than there is: in a few steps all of it.
        for _ in 0..CODE_OFFSET_STEPS {
            match common_code_offset(&refined(&found)) {
                Some((more, sigma)) if more.abs() > SIGNIFICANT * sigma => code_offset += more,
                _ => break,
            }
            found = region(short, code_offset).refine_all(&cells, &asked);
        }
        let samples = head.block.channel(0);
        if let Some(slip) = find_missing_samples(samples, rate_hz, &cells, code_offset) {
            emit(Event::Notice(Notice::Slip { slip, rate_hz }));
            end = end.min(slip.after);
        }
        found = region(end, code_offset).refine_all(&cells, &asked);
        if let Some((more, sigma)) = common_code_offset(&refined(&found))
            && more.abs() > SIGNIFICANT * sigma
        {
            code_offset += more;
            found = region(end, code_offset).refine_all(&cells, &asked);
        }
    }
    let gps = found
        .iter()
        .filter(|f| f.refined.acquisition.sv().constellation() == Constellation::Gps)
        .count();
    let most = most_in_view(options.positioning.max_height_m);
    if gps > most && high - low < LOW_ORBIT_HZ {
        emit(Event::Notice(Notice::TooMany { found: gps, most }));
        found.clear();
    }
    emit(Event::Found(found.iter().map(|f| f.refined).collect()));
    let sky = (head.block.channels() > 1).then(|| {
        let mut sky = ArraySky::default();
        if let Some(survey) = surveyed {
            survey.notices.into_iter().for_each(|notice| emit(Event::Notice(notice)));
            sky = survey.sky;
        }
        see(sky, &found, interference, options)
    });
    Ok(HeadFound { found, sky, code_offset, doppler_hz: asked.doppler_hz })
}

/// Most satellites of GPS that can be above the horizon of a receiver up to this height: so much of the sphere of their
/// orbits it sees, and twice the standard deviation of 32 independent places, which orbits in six planes do not reach.
fn most_in_view(height_m: f64) -> usize {
    const ORBIT_M: f64 = 26.56e6;
    let seen = (WGS84_A / (WGS84_A + height_m)).acos() + (WGS84_A / ORBIT_M).acos();
    let share = 0.5 * (1.0 - seen.cos());
    let satellites = Sv::all_gps().count() as f64;
    (satellites * share + 2.0 * (satellites * share * (1.0 - share)).sqrt()) as usize
}

/// Windows of a deeper search: 16 of one channel, fewer of more channels, whose powers count too.
pub(super) fn deep_windows(channels: usize) -> usize {
    if channels == 1 { 16 } else { (32 / channels).max(4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn no_receiver_sees_more_satellites_than_can_be_in_view() {
        // Six planes of 55 degrees, 32 places in all, seen from all latitudes through half an orbit.
        let orbit = |k: usize, t: f64| {
            let (plane, slot) = (k % 6, k / 6);
            let u = t + (slot as f64 / 5.4 + plane as f64 * 0.09) * std::f64::consts::TAU;
            let node = plane as f64 * std::f64::consts::TAU / 6.0;
            let (tilt_sin, tilt_cos) = 55f64.to_radians().sin_cos();
            let (x, y, z) = (u.cos(), u.sin() * tilt_cos, u.sin() * tilt_sin);
            let (sin, cos) = node.sin_cos();
            26.56e6 * Vector3::new(x * cos - y * sin, x * sin + y * cos, z)
        };
        for height_m in [0.0, 20e3, 550e3, 1200e3] {
            let most = most_in_view(height_m);
            let mut seen = 0;
            for t in (0..60).map(|k| f64::from(k) * 0.052) {
                for latitude in (-90..=90).step_by(5).map(|d| f64::from(d).to_radians()) {
                    let up = Vector3::new(latitude.cos(), 0.0, latitude.sin());
                    let receiver = up * (WGS84_A + height_m);
                    // Above the limb of the Earth.
                    let limb = -(1.0 - (WGS84_A / receiver.norm()).powi(2)).sqrt();
                    let is_up = |k: &usize| {
                        let line = orbit(*k, t) - receiver;
                        line.dot(&up) > limb * line.norm()
                    };
                    seen = seen.max((0..32).filter(is_up).count());
                }
            }
            println!("{:.0} km: {seen} of at most {most}", height_m / 1e3);
            assert!(seen <= most && most < 32, "{height_m} m: {seen} of {most}");
        }
    }
}
