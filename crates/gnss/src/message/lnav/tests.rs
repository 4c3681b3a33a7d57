use super::*;
use crate::GpsTime;
use crate::atmosphere::Klobuchar;
use crate::constants::GPS_PI;
use crate::navigation_data::UtcParameters;
use crate::orbit::broadcast::sample_ephemeris;
use proptest::prelude::*;

fn round_trip(header: &Header, message: &LnavMessage) -> (Header, LnavMessage) {
    let sent = encode_subframe(header, message).unwrap();
    assert_eq!(sent[1] & 3, 0, "the HOW ends in 00");
    assert_eq!(sent[9] & 3, 0, "word 10 ends in 00");
    let words = decode_words(&sent, 0).expect("own parity holds");
    assert!(Header::is_plausible(&words));
    decode_subframe(&words)
}

/// Subframe 1 of a frame, laid out by hand from IS-GPS-200N figure 20-1 sheet 1: week 142 (2190 mod
/// 1024), L2 code 1, URA 2, health 0, IODC 0x127, T_GD 11, t_oc 518400 s = 32400, af2 -1, af1 -88, af0 3.
#[test]
fn subframe_one_is_laid_out_as_the_interface_specification_draws_it() {
    let s1 = Subframe1 {
        week: 142,
        l2_codes: 1,
        ura_index: 2,
        health: 0,
        iodc: 0x127,
        l2_p_data: true,
        tgd: 11.0 * 2f64.powi(-31),
        toc: 518_400.0,
        af2: -(2f64.powi(-55)),
        af1: -88.0 * 2f64.powi(-43),
        af0: 3.0 * 2f64.powi(-31),
    };
    let sent = encode_subframe(&Header::new(1, 511_218.0), &LnavMessage::Clock(s1)).unwrap();
    let data = decode_words(&sent, 0).unwrap();
    assert_eq!(data[0], 0x8B << 16);
    assert_eq!(data[1] >> 2, (511_218 / 6 + 1) << 5 | 1);
    assert_eq!(data[2], 142 << 14 | 1 << 12 | 2 << 8 | 1);
    assert_eq!(data[3] >> 23, 1);
    assert_eq!(data[6] & 0xFF, 11);
    assert_eq!(data[7], 0x27 << 16 | 32_400);
    assert_eq!(data[8], 0xFF << 16 | (0x1_0000 - 88));
    assert_eq!(data[9] >> 2, 3);
}

#[test]
fn an_ephemeris_survives_the_signal_to_half_a_unit_of_each_field() {
    let eph = sample_ephemeris();
    let frame_tow = 511_200.0;
    let send = |id: u8, message: LnavMessage| {
        round_trip(&Header::new(id, frame_tow + 6.0 * f64::from(id - 1)), &message).1
    };
    let (LnavMessage::Clock(s1), LnavMessage::Orbit(s2), LnavMessage::Orientation(s3)) = (
        send(1, LnavMessage::Clock(Subframe1::new(&eph, 2190))),
        send(2, LnavMessage::Orbit((&eph).into())),
        send(3, LnavMessage::Orientation((&eph).into())),
    ) else {
        panic!("each subframe decodes to its own kind")
    };
    let back = assemble(eph.sv, (&s1, &s2, &s3), frame_tow, DEFAULT_REFERENCE_WEEK).unwrap();
    assert_eq!((back.toe, back.toc, back.iodc), (eph.toe, eph.toc, eph.iodc));
    assert_eq!(back.transmission_time, Some(GpsTime::from_week_tow(2190, frame_tow)));
    // The file prints 13 digits, more than any field holds: what comes back must be the printed value
    // to its digits (5e-13 relative), not only to half a unit.
    for (ours, theirs) in [
        (back.af0, eph.af0),
        (back.af1, eph.af1),
        (back.tgd, eph.tgd),
        (back.sqrt_a, eph.sqrt_a),
        (back.e, eph.e),
        (back.m0, eph.m0),
        (back.delta_n, eph.delta_n),
        (back.omega0, eph.omega0),
        (back.omega_dot, eph.omega_dot),
        (back.i0, eph.i0),
        (back.idot, eph.idot),
        (back.omega, eph.omega),
        (back.cuc, eph.cuc),
        (back.cus, eph.cus),
        (back.crc, eph.crc),
        (back.crs, eph.crs),
        (back.cic, eph.cic),
        (back.cis, eph.cis),
    ] {
        assert!((ours - theirs).abs() <= 5e-12 * theirs.abs(), "{ours:e} {theirs:e}");
    }
    let stale = Subframe3 { iode: 40, ..s3 };
    assert_eq!(assemble(eph.sv, (&s1, &s2, &stale), frame_tow, DEFAULT_REFERENCE_WEEK), None);
}

#[test]
fn reference_times_beyond_the_week_crossover_are_those_nearest_the_transmission() {
    let mut eph = sample_ephemeris();
    eph.toe = GpsTime::from_week_tow(2191, 0.0);
    eph.toc = eph.toe;
    let parts = (&Subframe1::new(&eph, 2190), &Subframe2::from(&eph), &Subframe3::from(&eph));
    let back = assemble(eph.sv, parts, 603_000.0, DEFAULT_REFERENCE_WEEK).unwrap();
    assert_eq!((back.toe, back.toc), (eph.toe, eph.toe));
}

#[test]
fn an_almanac_made_of_an_ephemeris_puts_the_satellite_where_the_ephemeris_does() {
    let eph = sample_ephemeris();
    let toa = GpsTime::from_week_tow(2191, 4096.0);
    let LnavMessage::Almanac(alm) =
        round_trip(&Header::new(5, 0.0), &LnavMessage::Almanac(Almanac::new(&eph, toa))).1
    else {
        panic!("an almanac page")
    };
    let zero =
        crate::Ephemeris { toe: toa, e: alm.e, sqrt_a: alm.sqrt_a, m0: alm.m0, ..eph.clone() };
    let from_almanac = crate::Ephemeris {
        omega0: alm.omega0,
        omega: alm.omega,
        omega_dot: alm.omega_dot,
        i0: alm.delta_i + 0.3 * GPS_PI,
        ..zero
    };
    // Half units at 26 560 km: five angles of 2^-24 semicircles 5 m each (2^-20 for i: 80 m), sqrt A of
    // 2^-12 35 m and, with t_oa at hand, no drift.
    let miss = from_almanac.state(toa).position_m - eph.state(toa).position_m;
    assert!(miss.norm() < 150.0, "{miss}");
}

#[test]
fn values_that_do_not_fit_are_refused_with_their_name() {
    let eph = crate::Ephemeris { tgd: 1e-6, ..sample_ephemeris() };
    let error =
        encode_subframe(&Header::new(1, 0.0), &LnavMessage::Clock(Subframe1::new(&eph, 2190)));
    assert!(error.unwrap_err().to_string().contains("T_GD = 1e-6 does not fit"));
    let nan = crate::Ephemeris { m0: f64::NAN, ..sample_ephemeris() };
    assert!(encode_subframe(&Header::new(2, 0.0), &LnavMessage::Orbit((&nan).into())).is_err());
}

#[test]
fn weeks_resolve_to_the_nearest_of_their_residue() {
    // Without other information a week is one of the 1024 up to that of the build: 2190 and 2048 are past, and 1734 of
    // 2013 comes again in 2032.
    for week in [2190, 2048, 1734] {
        assert_eq!(resolve_week(week as u32 % 1024, 10, DEFAULT_REFERENCE_WEEK), week);
    }
    assert_eq!(resolve_week(BUILD_WEEK as u32 % 1024, 10, DEFAULT_REFERENCE_WEEK), BUILD_WEEK);
    let next = (BUILD_WEEK + 1) as u32 % 1024;
    assert_eq!(resolve_week(next, 10, DEFAULT_REFERENCE_WEEK), BUILD_WEEK - 1023);
    assert_eq!(resolve_week(1023, 10, 1024), 1023);
    assert_eq!(resolve_week(0, 8, 2190), 2304);
}

#[test]
fn tow_counts_wrap_at_the_end_of_the_week() {
    let last = Header::new(5, 604_794.0);
    assert_eq!((last.tow_count, last.tow()), (0, 604_794.0));
    assert_eq!(Header::new(1, 0.0).tow_count, 1);
}

/// Table 20-V: where the almanacs of satellites 25 to 32 and the special pages lie.
#[test]
fn pages_carry_the_identities_of_the_interface_specification() {
    let ids: Vec<u8> = (1..=25).map(|page| page_sv_id(4, page)).collect();
    let expected = [
        57, 25, 26, 27, 28, 57, 29, 30, 31, 32, 57, 62, 52, 53, 54, 57, 55, 56, 58, 59, 57, 60, 61,
        62, 63,
    ];
    assert_eq!(ids, expected);
    assert_eq!((page_sv_id(5, 24), page_sv_id(5, 25)), (24, 51));
}

/// A multiple of 2^`exponent` that `bits` bits hold, signed, and any point within half a unit of it.
fn near(bits: u32, exponent: i32) -> impl Strategy<Value = f64> {
    let half = 1i64 << (bits - 1);
    (-half..half - 1, -0.499f64..0.499)
        .prop_map(move |(count, off)| (count as f64 + off) * 2f64.powi(exponent))
}

proptest! {
    #[test]
    fn ionosphere_and_utc_round_trip_to_half_a_unit(
        a in (near(8, -30), near(8, -27), near(8, -24), near(8, -24)),
        b in (near(8, 11), near(8, 14), near(8, 16), near(8, 16)),
        (a0, a1) in (near(32, -30), near(24, -50)),
        (tot, week, off) in (0u32..147, 2048i32..3000, -100i32..100),
        (ls, lsf, day) in (-128i32..128, -128i32..128, 1u8..8),
    ) {
        let klobuchar = Klobuchar { alpha: [a.0, a.1, a.2, a.3], beta: [b.0, b.1, b.2, b.3] };
        let tot = GpsTime::from_week_tow(week, f64::from(tot) * 4096.0);
        let utc = UtcParameters { a0, a1, tot, delta_t_ls: ls, delta_t_lsf: lsf, wn_lsf: week + off, day };
        let page = IonosphereUtc::new(klobuchar, &utc);
        let (_, message) = round_trip(&Header::new(4, 18.0), &LnavMessage::IonosphereUtc(page));
        let LnavMessage::IonosphereUtc(back) = message else { panic!("page 18") };
        for (k, (ea, eb)) in [(-30, 11), (-27, 14), (-24, 16), (-24, 16)].into_iter().enumerate() {
            prop_assert!((back.klobuchar.alpha[k] - klobuchar.alpha[k]).abs() <= 2f64.powi(ea - 1));
            prop_assert!((back.klobuchar.beta[k] - klobuchar.beta[k]).abs() <= 2f64.powi(eb - 1));
        }
        let back = back.utc(week);
        prop_assert!((back.a0 - a0).abs() <= 2f64.powi(-31) && (back.a1 - a1).abs() <= 2f64.powi(-51));
        prop_assert_eq!(UtcParameters { a0, a1, ..back }, utc);
    }

    #[test]
    fn orbit_angles_round_trip_over_whole_turns(m0 in -10.0f64..10.0, e in 0.0f64..0.49, toe in 0u32..37_800) {
        let s2 = Subframe2 { m0, e, toe: f64::from(toe) * 16.0, ..Subframe2::default() };
        let (_, message) = round_trip(&Header::new(2, 6.0), &LnavMessage::Orbit(s2.clone()));
        let LnavMessage::Orbit(back) = message else { panic!("subframe 2") };
        let turn = 2.0 * GPS_PI;
        let miss = (back.m0 - m0 + GPS_PI).rem_euclid(turn) - GPS_PI;
        // Half a unit, and rounding of the turn.
        prop_assert!(miss.abs() <= 2f64.powi(-32) * GPS_PI + 1e-14);
        prop_assert!((back.e - e).abs() <= 2f64.powi(-34));
        prop_assert_eq!(back.toe, s2.toe);
    }

    #[test]
    fn header_health_and_configuration_round_trip(
        telemetry in 0u16..1 << 14, tow_count in 0u32..TOW_COUNTS, flags: [bool; 3],
        health in prop::array::uniform24(0u8..64), more in prop::array::uniform8(0u8..64),
        configuration in prop::array::uniform32(0u8..16), week_a: u8, toa in 0u32..148,
    ) {
        let [integrity, alert, anti_spoof] = flags;
        let header = Header { telemetry, integrity, tow_count, alert, anti_spoof, id: 5 };
        let page = LnavMessage::Health1To24(Health1To24 { toa: f64::from(toa) * 4096.0, week_a, health });
        prop_assert_eq!(round_trip(&header, &page), (header.clone(), page));
        let header = Header { id: 4, ..header };
        let page = LnavMessage::Health25To32(Health25To32 { configuration, health: more });
        prop_assert_eq!(round_trip(&header, &page), (header.clone(), page));
    }

    #[test]
    fn anything_that_passes_parity_decodes_without_panic(words: [u32; 10]) {
        let words = words.map(|w| w & 0xFF_FFFF);
        let _ = (decode_subframe(&words), decode_words(&words.map(|w| w & 0x3FFF_FFFF), 0));
    }
}

/// Pages of GPS that QZSS repeats are read as GPS sends them; its own, under data ID 3, are left alone: SV ID
/// 61 holds an ionosphere of Japan alone (IS-QZSS-PNT-005 4.1.2.6).
#[test]
fn pages_are_read_by_their_data_id() {
    let page = LnavMessage::IonosphereUtc(IonosphereUtc { delta_t_ls: 18.0, ..Default::default() });
    let read = |message: &LnavMessage, data_id| {
        let sent = encode_with_data_id(&Header::new(4, 0.0), message, data_id).unwrap();
        decode_subframe(&decode_words(&sent, 0).unwrap()).1
    };
    assert_eq!(read(&page, DATA_ID_GPS), page);
    assert_eq!(read(&page, DATA_ID_REPEATED), page);
    assert_eq!(read(&page, 3), LnavMessage::Other(56));
    assert_eq!(read(&LnavMessage::Other(61), 3), LnavMessage::Other(61));
}
