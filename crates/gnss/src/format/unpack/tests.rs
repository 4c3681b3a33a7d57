use super::*;
use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::io::Write;
use std::process::{Command, Stdio};

fn all(packed: &[u8], limit: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    unpack(packed, limit)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// LZW as `compress` writes it, the table cleared after every `clear` entries of a full one. gzip, which reads it, is the
/// judge.
fn compress(bytes: &[u8], longest: u32, clear: usize) -> Vec<u8> {
    let mut packed = vec![0x1F, 0x9D, 0x80 | longest as u8];
    let (mut table, mut free, mut width) = (BTreeMap::new(), 257usize, 9u32);
    let mut bits: Vec<bool> = Vec::new();
    let mut full = 0;
    let put = |code: usize, width: u32, bits: &mut Vec<bool>| {
        bits.extend((0..width).map(|k| code >> k & 1 == 1));
    };
    let pad = |bits: &mut Vec<bool>, width: u32, start: usize| {
        let group = 8 * width as usize;
        let end = start + (bits.len() - start).next_multiple_of(group);
        bits.resize(end, false);
        end
    };
    let mut start = 0;
    let mut at: Option<usize> = None;
    for &byte in bytes {
        let Some(code) = at else {
            at = Some(byte.into());
            continue;
        };
        if let Some(&longer) = table.get(&(code, byte)) {
            at = Some(longer);
            continue;
        }
        put(code, width, &mut bits);
        at = Some(byte.into());
        if free < 1 << longest {
            table.insert((code, byte), free);
            free += 1;
            // The decoder is an entry behind.
            if free > 1 << width && width < longest {
                start = pad(&mut bits, width, start);
                width += 1;
            }
        } else {
            full += 1;
        }
        if full == clear {
            put(256, width, &mut bits);
            start = pad(&mut bits, width, start);
            table.clear();
            (free, width, full) = (257, 9, 0);
        }
    }
    at.into_iter().for_each(|code| put(code, width, &mut bits));
    packed.extend(
        bits.chunks(8).map(|byte| {
            byte.iter().enumerate().fold(0u8, |sum, (k, bit)| sum | u8::from(*bit) << k)
        }),
    );
    packed
}

/// What gzip makes of packed bytes, none where it is not installed.
fn by_gzip(packed: &[u8]) -> Option<Vec<u8>> {
    let mut child = Command::new("gzip")
        .arg("-dc")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .ok()?;
    let mut input = child.stdin.take()?;
    let packed = packed.to_vec();
    let writer = std::thread::spawn(move || input.write_all(&packed));
    let output = child.wait_with_output().ok()?;
    writer.join().ok()?.ok()?;
    Some(output.stdout)
}

/// Text such as that of a RINEX file, and bytes of any value.
fn samples() -> [Vec<u8>; 3] {
    let mut state = 1u64;
    let mut random = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    };
    let numbers =
        (0..40_000).map(|_| format!("{:14.3}\n", random() as f64 / 1e3)).collect::<String>();
    [numbers.into_bytes(), (0..300_000).map(|_| random() as u8).collect(), vec![b'0'; 200_000]]
}

#[test]
fn what_compress_wrote_is_read() {
    // By ncompress 4.2.4: `printf 'GPS GPS GPS GPS\nQZSS QZSS\n' | compress -c`.
    let packed = [
        0x1F, 0x9D, 0x90, 0x47, 0xA0, 0x4C, 0x01, 0x11, 0x70, 0x60, 0x41, 0x82, 0x02, 0x15, 0x44,
        0xD1, 0x32, 0x65, 0xE0, 0xC2, 0x86, 0x0A, 0x00,
    ];
    assert_eq!(all(&packed, 100).unwrap(), b"GPS GPS GPS GPS\nQZSS QZSS\n");
    for bytes in samples() {
        for (longest, clear) in [(16, 20_000), (16, usize::MAX), (12, 3000), (10, 1)] {
            let packed = compress(&bytes, longest, clear);
            if let Some(theirs) = by_gzip(&packed) {
                assert!(theirs == bytes, "gzip reads something else ({longest} bits)");
            }
            assert!(all(&packed, 1 << 20).unwrap() == bytes, "{longest} bits, {clear}");
        }
    }
}

#[test]
fn what_gzip_wrote_is_read_one_file_after_the_other() {
    let [text, noise, _] = samples();
    let packed = [gzip(&text), gzip(&noise), gzip(b"")].concat();
    assert!(all(&packed, 1 << 24).unwrap() == [text.clone(), noise].concat());
    assert_eq!(all(&text, 1 << 24).unwrap(), text);
    assert_eq!(all(b"", 1).unwrap(), b"");
    assert_eq!(all(b"#", 1).unwrap(), b"#");
}

#[test]
fn damage_keeps_what_came_before_and_a_bomb_is_refused() {
    let [text, ..] = samples();
    for packed in [gzip(&text), compress(&text, 16, 1000)] {
        let mut bytes = Vec::new();
        let cut = &packed[..packed.len() / 2];
        match unpack(cut, 1 << 24).unwrap().read_to_end(&mut bytes) {
            Err(error) => assert!(is_damage(&error), "{error}"),
            // LZW that ends between two codes is an end as any other.
            Ok(_) => assert_eq!(packed[1], 0x9D),
        }
        assert!(bytes.len() > text.len() / 4 && text.starts_with(&bytes));
        let error = all(&packed, text.len() as u64 - 1).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
    }
    let error = all(b"BZh91AY&SY", 10).err().unwrap().to_string();
    assert!(error.contains("bzip2") && error.contains("gzip"), "{error}");
    let error = all(&[0x1F, 0x9D, 0x9F, 0], 10).err().unwrap().to_string();
    assert!(error.contains("31 bits; 9 to 16"), "{error}");
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(
        mut packed in prop::collection::vec(any::<u8>(), 0..300),
        gzipped in any::<bool>(),
        longest in 9u8..=16,
    ) {
        let head = if gzipped { vec![0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 0, 3] } else { vec![0x1F, 0x9D, 0x80 | longest] };
        packed.splice(0..0, head);
        let _ = all(&packed, 1 << 20);
    }
}
