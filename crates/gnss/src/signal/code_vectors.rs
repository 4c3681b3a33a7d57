//! Codes of other implementations, as digests (`SDR_RX_DATA`, `signals/codes/vectors.json`).

use sha2_const_stable::Sha256;
use std::ops::RangeInclusive;

/// Some of the digests, for tests without the file: SHA-256 of the code as bits, filled up with zeros to a byte.
const DIGESTS: [(&str, u8, &str); 11] = [
    ("E1B", 1, "d9212f8fbc551ced4adbe5bf5f68e1fde15fd8940717991f09968ff3c791aafa"),
    ("E1B", 2, "c66f97df64d2f0391af35b1cf2612d1896529ade69fc0e53fd7415273985d15c"),
    ("E1C", 1, "54dc4b793f248b50f12faacf9e402eb4ca5262bfae3d62a177aa13113aca7240"),
    ("B1C_data", 1, "82127c8762269cfa11fd7dbf0d50a89dd59e1c56d0692d4673dba88c9b67c262"),
    ("B1C_pilot", 1, "a60b4efa9d18f3b60924077a1eab5e0c8534ad40f6ee926fb9bdb3d1bf9252fb"),
    ("B1C_pilot_secondary", 1, "360fcb3f287f2f76729c63185a5f2e26cfe7df734b27730b9349d75634d50cc7"),
    ("B1I", 1, "1b5b8b76f838da7a97eb80c2a13a8827c7d3d77038318bf9c17ea7b12efc4517"),
    ("GPS_L1C_D", 1, "39f09dbc3fff435b2404511a4bad3dc2232554a598ec645b56d63ed3f984c6f4"),
    ("GPS_L1C_P", 1, "f32e2a3005341850aa6b21a02bac6e5c0152b8924192b0edcba1ee2921992efb"),
    ("GPS_L1C_overlay", 1, "76be5d4f8c05842e77c288132229ed6e057868af130f3b432b140a59fe4b0490"),
    ("GLONASS_L1OF", 0, "6b41807c097057b49b4bf286eede39e488a9a5ab5c8c89542b23fb35171c87e4"),
];

/// The logic levels of chips as hexadecimal digits, filled up with zeros.
pub(super) fn hexadecimal(chips: &[i8]) -> String {
    let digit = |chips: &[i8]| (0..4).fold(0, |d, k| d << 1 | u8::from(chips.get(k) == Some(&-1)));
    chips.chunks(4).map(|four| format!("{:X}", digit(four))).collect()
}

fn digest(chips: &[i8]) -> String {
    let bit = |chips: &[i8], k| u8::from(chips.get(k) == Some(&-1));
    let bytes: Vec<u8> =
        chips.chunks(8).map(|eight| (0..8).fold(0, |byte, k| byte << 1 | bit(eight, k))).collect();
    let digest = Sha256::new().update(&bytes).finalize();
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Compares the codes of all numbers with the digests of the family of this name.
pub(super) fn check_all(
    family: &str,
    code: impl Fn(u8) -> Option<Box<[i8]>>,
    numbers: RangeInclusive<u8>,
) {
    for (_, number, expected) in DIGESTS.iter().filter(|d| d.0 == family) {
        assert_eq!(digest(&code(*number).unwrap()), *expected, "{family} {number}");
    }
    let Some(folder) = std::env::var_os("SDR_RX_DATA") else {
        println!("SDR_RX_DATA is not set: all but a few digests are passed over");
        return;
    };
    let path = std::path::Path::new(&folder).join("signals/codes/vectors.json");
    let vectors: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    for number in numbers {
        let expected = &vectors[family][number.to_string()]["sha256_packed"];
        assert_eq!(digest(&code(number).unwrap()), expected.as_str().unwrap(), "{family} {number}");
    }
}
