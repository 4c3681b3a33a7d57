//! The GPS week of the build: a recording is not of its future.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=SOURCE_DATE_EPOCH");
    // 1980-01-06 in seconds of Unix time.
    const GPS_EPOCH_S: u64 = 315_964_800;
    let given = std::env::var("SOURCE_DATE_EPOCH").ok().and_then(|s| s.parse::<u64>().ok());
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let unix_s = given.unwrap_or(now.map_or(0, |since| since.as_secs()));
    let week = unix_s.saturating_sub(GPS_EPOCH_S) / 604_800;
    println!("cargo::rustc-env=SDR_RX_BUILD_WEEK={week}");
}
