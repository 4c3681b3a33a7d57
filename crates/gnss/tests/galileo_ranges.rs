//! Ephemerides of Galileo, as RINEX files hold them, against ranges that a receiver of others measured at a known place (`SDR_RX_DATA`,
//! `obs/matrtklib-static`).

use nalgebra::Vector3;
use sdr_rx_gnss::atmosphere::{Klobuchar, Troposphere};
use sdr_rx_gnss::constants::SPEED_OF_LIGHT;
use sdr_rx_gnss::coordinates::{Geodetic, azimuth_elevation};
use sdr_rx_gnss::format::rinex_nav;
use sdr_rx_gnss::orbit::Propagation;
use sdr_rx_gnss::{GpsTime, NavigationData, Sv};

/// A number of a fixed column of RINEX.
fn number(line: &str, from: usize, width: usize) -> f64 {
    line[from..].chars().take(width).collect::<String>().trim().parse().unwrap_or(0.0)
}

fn epoch(line: &str, from: usize) -> GpsTime {
    let part = |k: usize| line[from..].split_whitespace().nth(k).unwrap();
    let whole = |k: usize| part(k).parse::<u32>().unwrap();
    let seconds = part(5).get(..2).unwrap_or(part(5)).parse().unwrap();
    GpsTime::from_calendar(whole(0) as i32, whole(1), whole(2), whole(3), whole(4), seconds)
}

/// Code ranges C1C of Galileo, the second observable of the file after X1, by epoch.
fn ranges(text: &str) -> Vec<(GpsTime, Vec<(Sv, f64)>)> {
    let mut epochs = Vec::new();
    for line in text.lines().skip_while(|line| !line.contains("END OF HEADER")) {
        if let Some(rest) = line.strip_prefix("> ") {
            epochs.push((epoch(rest, 0), Vec::new()));
        } else if let (true, Some((_, list))) = (line.starts_with('E'), epochs.last_mut()) {
            let range_m = number(line, 19, 14);
            list.extend((range_m > 0.0).then(|| (line[..3].parse().unwrap(), range_m)));
        }
    }
    epochs
}

/// Measured less computed ranges, m, of the satellites above 15 degrees.
fn residuals(
    receiver_m: &Vector3<f64>,
    (t, ranges): &(GpsTime, Vec<(Sv, f64)>),
    data: &NavigationData,
    ionosphere: &Klobuchar,
) -> Vec<(Sv, f64)> {
    let place = Geodetic::from_ecef(receiver_m);
    let residual = |&(sv, range_m): &(Sv, f64)| {
        let propagation = Propagation::solve(data.orbit(sv, *t).ok()?, receiver_m, *t);

        let (azimuth, elevation) = azimuth_elevation(receiver_m, &propagation.satellite.position_m);
        let delays_m = ionosphere.delay_m(place, azimuth, elevation, *t)
            + Troposphere::Saastamoinen.delay_m(place, elevation);
        let clock_m = SPEED_OF_LIGHT * propagation.satellite.clock_bias_s;
        let computed_m = propagation.range_m - clock_m + delays_m;
        (elevation > 15f64.to_radians()).then_some((sv, range_m - computed_m))
    };
    ranges.iter().filter_map(residual).collect()
}

/// With orbits and clocks good to a metre, a broadcast ionosphere and code noise of some decimetres, what is left after
/// the receiver's clock is some metres: RTKLIB solves this file's Galileo to 2.2 m.
#[test]
fn ranges_of_galileo_at_a_known_place_agree_with_its_ephemerides() {
    let Some(folder) = std::env::var_os("SDR_RX_DATA") else {
        println!("SDR_RX_DATA is not set: measured ranges of Galileo are passed over");
        return;
    };
    let folder = std::path::Path::new(&folder).join("obs/matrtklib-static");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let place = read("base_position.txt");
    let mut numbers = place.split_whitespace().filter_map(|word| word.parse::<f64>().ok());
    let degrees: [f64; 3] = std::array::from_fn(|_| numbers.next().unwrap());
    let receiver_m = Geodetic::from_degrees(degrees[0], degrees[1], degrees[2]).to_ecef();
    let data = rinex_nav::read(folder.join("base.nav")).unwrap().data;
    let ionosphere = data.ionosphere.unwrap();
    for epoch in ranges(&read("base.obs")).iter().step_by(60) {
        let left = residuals(&receiver_m, epoch, &data, &ionosphere);
        let count = left.len() as f64;
        let mean_m = left.iter().map(|(_, m)| m).sum::<f64>() / count;
        let rms_m = (left.iter().map(|(_, m)| (m - mean_m).powi(2)).sum::<f64>() / count).sqrt();
        assert!(left.len() >= 5 && rms_m < 2.2, "{}: {left:?}, {rms_m} m", epoch.0);
    }
}
