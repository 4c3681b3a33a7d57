//! Each format read back by an independent reader.

use crate::common::{Tested, data};
use crate::scene::{EPOCHS, Scene, TRUTH_M};
use sdr_rx::gnss::NavigationData;
use sdr_rx::gnss::coordinates::Geodetic;
use sdr_rx::gnss::format::rinex_nav;
use sdr_rx::position::Integrity;
use sdr_rx::report::{self, OutputDir, write_all};

/// Our 13 digits carry every file's 12 or 13, so ephemerides come back to the last bit. Klobuchar
/// coefficients have 5 digits and UTC terms 11 and 10 (RINEX 3.04 table A5): half of the last digit is
/// 5e-5, 5e-11 and 5e-10.
#[test]
fn navigation_files_survive_our_writer() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    for name in [
        "nav/brdc0010.22n",
        "obs/matrtklib-static/base.nav",
        "obs/gps-sdr-sim-rtk/base.nav",
        "obs/gnsstk-arlm/arlm2000.15n",
        "obs/rtklib-geonet/07590920.05n",
    ] {
        let original = rinex_nav::read(data.join(name))?.data;
        let text = sdr_rx::gnss::format::rinex_nav::write(&original);
        assert!(text.lines().all(|l| l.len() <= 80), "{name}: RINEX lines have 80 columns");
        let back = rinex_nav::parse(&text, "ours")?.data;
        for (ours, theirs) in back.iter().zip(original.iter()) {
            assert_eq!(ours, theirs, "{name}");
        }
        assert_eq!(back.iter().count(), original.iter().count());
        let coefficients = |data: &NavigationData| {
            data.ionosphere.map_or(Vec::new(), |k| [k.alpha, k.beta].concat())
        };
        let (ours, theirs) = (coefficients(&back), coefficients(&original));
        assert_eq!(ours.len(), theirs.len());
        assert!(ours.iter().zip(&theirs).all(|(a, b)| (a - b).abs() <= 5.1e-5 * b.abs()));
        assert_eq!(back.utc.is_some(), original.utc.is_some());
        if let (Some(ours), Some(theirs)) = (back.utc, original.utc) {
            assert!((ours.a0 - theirs.a0).abs() <= 5.1e-11 * theirs.a0.abs());
            assert!((ours.a1 - theirs.a1).abs() <= 5.1e-10 * theirs.a1.abs());
            assert_eq!(
                (ours.tot, ours.delta_t_ls, ours.wn_lsf),
                (theirs.tot, theirs.delta_t_ls, theirs.wn_lsf)
            );
        }
    }
    Ok(())
}

#[test]
fn json_holds_the_stable_fields() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let document: serde_json::Value = serde_json::from_str(&report::json(&scene.run()))?;
    assert_eq!(document["schema"], "sdr-rx/1");
    assert_eq!(
        (&document["seed"], &document["options"]["troposphere"]),
        (&7.into(), &"none".into())
    );
    let fix = &document["fixes"][0];
    assert_eq!((fix["gps_week"].as_i64(), fix["tow_s"].as_f64()), (Some(2190), Some(525_600.0)));
    assert_eq!(
        (&fix["utc"], &fix["method"]),
        (&"2022-01-01T01:59:42.000Z".into(), &"tracking".into())
    );
    // The fix is 1 m east of the true position: 1.1e-5 deg of longitude there.
    let position = Geodetic::from_ecef(&TRUTH_M);
    let east = fix["lon_deg"].as_f64().unwrap_or(f64::NAN) - position.longitude.to_degrees();
    assert!((east.to_radians() * 6.378e6 * position.latitude.cos() - 1.0).abs() < 0.01);
    // Half a code period of 1000 us from the start of a code period to the next.
    let offset = document["acquisitions"][0]["code_offset_us"].as_f64().unwrap_or(f64::NAN);
    assert!((offset - 500.0).abs() < 1e-9);
    for absent in ["reason", "sky"] {
        assert!(document.get(absent).is_none());
    }
    assert!(fix.get("excluded").is_none() && document["capture"].get("start_utc").is_none());
    let run = report::Run {
        fixes: &[],
        reason: Some("three satellites, four are needed"),
        ..scene.run()
    };
    let document: serde_json::Value = serde_json::from_str(&report::json(&run))?;
    assert_eq!(document["reason"], "three satellites, four are needed");
    assert_eq!(document["fixes"].as_array().map(Vec::len), Some(0));
    Ok(())
}

#[test]
fn nmea_sentences_are_well_formed() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let text = report::nmea(&scene.run());
    assert!(text.ends_with("\r\n"));
    for sentence in text.split_terminator("\r\n") {
        assert!(sentence.len() <= 80, "NMEA allows 82 characters with CR LF: {sentence}");
        let (body, checksum) = sentence[1..].split_once('*').ok_or("no checksum")?;
        let sum = body.bytes().fold(0u8, |s, b| s ^ b);
        assert_eq!(format!("{sum:02X}"), checksum);
        assert!(sentence.starts_with("$GP"), "GPS alone has the talker GP");
    }
    assert_eq!(text.matches("$GPGGA,015942.000,3540.").count(), 1);
    // 2 m/s to the north, in knots of 1852 m/h.
    assert!(text.contains(",3.888,0.00,010122,,,A*"), "{text}");
    assert_eq!(text.matches("$GPRMC").count(), EPOCHS);
    Ok(())
}

/// NMEA 0183 4.11: RMC status V is a warning, mode E an estimate, as is GGA's quality 6. GST's ellipse of equal
/// variances is a circle; its fields are standard deviations of 1 m.
#[test]
fn a_position_that_is_not_proved_is_marked_in_every_sentence_that_can() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let mut scene = Scene::new(data)?;
    let proved = report::nmea(&scene.run());
    scene.fixes.iter_mut().for_each(|fix| fix.integrity = Integrity::Unverified);
    let text = report::nmea(&scene.run());
    let fields = |text: &str, name: &str| -> Vec<String> {
        let line = text.lines().find(|l| l.starts_with(name)).unwrap_or_default();
        line.split([',', '*']).map(str::to_owned).collect()
    };
    for (text, status, mode, quality) in [(&proved, "A", "A", "1"), (&text, "V", "E", "6")] {
        let (rmc, gga) = (fields(text, "$GPRMC"), fields(text, "$GPGGA"));
        assert_eq!((&*rmc[2], &*rmc[12], &*gga[6]), (status, mode, quality));
        let gst = fields(text, "$GPGST");
        assert_eq!(gst[2], "0.50", "rms of the residuals");
        assert_eq!([&*gst[3], &*gst[4], &*gst[6], &*gst[7], &*gst[8]], ["1.00"; 5]);
    }
    let table = report::fix_table(&scene.run());
    assert!(table.starts_with("no verified fix: "), "{table}");
    Ok(())
}

#[test]
fn maps_put_longitude_first() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let map: geojson::GeoJson = report::geojson(&scene.run()).parse()?;
    let geojson::GeoJson::FeatureCollection(collection) = map else {
        return Err("no collection".into());
    };
    assert_eq!(collection.features.len(), EPOCHS + 1);
    let text = report::geojson(&scene.run());
    assert!(text.contains("[139.7662") && text.contains(",35.6812"), "longitude, latitude");
    let kml = report::kml(&scene.run());
    let tree = roxmltree::Document::parse(&kml)?;
    let coordinates: Vec<_> =
        tree.descendants().filter(|n| n.has_tag_name("coordinates")).collect();
    let track = coordinates[1].text().unwrap_or("");
    assert_eq!(track.split_whitespace().count(), EPOCHS);
    assert!(track.trim().starts_with("139.7662") && track.contains(",35.6812"));
    Ok(())
}

#[test]
fn plots_and_page_are_well_formed_and_whole() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let run = scene.run();
    let in_view = report::satellites_in_view(&run);
    assert_eq!(in_view.len(), scene.epochs[0].observations.len());
    let plot = report::sky_plot(&in_view)?;
    let tree = roxmltree::Document::parse(&plot)?;
    let circles = tree.descendants().filter(|n| n.has_tag_name("circle")).count();
    assert_eq!(circles, in_view.len(), "one disc a satellite");
    let summary = report::Summary::new(&scene.fixes, 2.6e6).ok_or("a summary")?;
    let scatter = report::east_north_plot(&summary)?;
    let circles = roxmltree::Document::parse(&scatter)?;
    assert_eq!(circles.descendants().filter(|n| n.has_tag_name("circle")).count(), EPOCHS);
    // Fifteen fixes 1 m to either side: all stand 1 m from the median, which lies between.
    assert!((summary.horizontal_50_m - 1.0).abs() < 1e-6 && summary.vertical_95_m < 1e-6);
    assert!((summary.median_m - TRUTH_M).norm() < 1e-6 && summary.first_fix_s == 0.0);
    let page = report::html(&run)?;
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(page.contains("scene &amp; co.bin") && page.contains("spectrum &lt;mirrored&gt;?"));
    assert!(
        !page.contains("http:")
            || page.matches("http:").count() == page.matches("http://www.w3.org").count()
    );
    Ok(())
}

#[test]
fn tables_list_what_was_found() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let run = scene.run();
    let found = report::acquisition_table(run.acquisitions);
    assert_eq!(found.lines().count(), run.acquisitions.len() + 1);
    let fixes = report::fix_table(&run);
    assert!(fixes.contains("35.68129") && fixes.contains("north +2.000"), "{fixes}");
    let sky = report::sky_plot_text(&report::satellites_in_view(&run));
    for o in &scene.epochs[0].observations {
        assert!(sky.contains(&o.sv().to_string()[1..]), "{} in\n{sky}", o.sv());
    }
    let none = report::Run { fixes: &[], reason: Some("too short"), ..run };
    assert_eq!(report::fix_table(&none), "no fix: too short\n");
    assert_eq!(report::acquisition_table(&[]), "no satellite found\n");
    Ok(())
}

#[test]
fn the_same_run_gives_the_same_bytes_and_no_stray_file() -> Tested {
    let Some(data) = data() else { return Ok(()) };
    let scene = Scene::new(data)?;
    let folders = [tempfile::tempdir()?, tempfile::tempdir()?];
    let mut contents = Vec::new();
    for folder in &folders {
        let paths = write_all(&scene.run(), &OutputDir::create(folder.path().join("a/b"))?, true)?;
        let entries = std::fs::read_dir(folder.path().join("a/b"))?.count();
        assert_eq!(entries, paths.len(), "no temporary file is left");
        let names: Vec<_> =
            paths.iter().map(|p| p.file_name().unwrap_or_default().to_owned()).collect();
        assert!(names.contains(&"SDRX00XXX_S_20220010200_30S_01S_MO.rnx".into()), "{names:?}");
        let bytes: Result<Vec<_>, _> = paths.iter().map(std::fs::read).collect();
        contents.push((names, bytes?));
    }
    assert_eq!(contents[0], contents[1]);
    // The error of a folder that cannot be made names it and what to do.
    let blocked = folders[0].path().join("a/b/result.json/sub");
    let error = OutputDir::create(blocked).unwrap_err().to_string();
    assert!(
        error.starts_with("making the output folder") && error.contains("files may be written"),
        "{error}"
    );
    Ok(())
}
