//! FEC2: words 1 to 4 from any four of the words 1 to 4 and 17 to 20 of one issue of data (Galileo OS SIS ICD 2.1,
//! 5.1.13).
//!
//! A Reed-Solomon code over GF(2^8), RS(255, 195) shortened to (118, 58): octets u_0 to u_57 of the words 1 to 4 without
//! what is known of them, and p_0 to p_59 in the words 17 to 20, 15 each. The polynomial sum p_j x^j + sum u_k x^(60 + k)
//! is zero at alpha^1 to alpha^60, alpha a root of x^8 + x^4 + x^3 + x^2 + 1. All words have passed their parity, so that
//! octets are missing, not wrong; up to 60 may be.
//!
//! Cost: up to 60 linear equations in the field, some 10^5 products, once an ephemeris at most.

use super::WordBits;
use super::contents::ParityWord;
use super::words::InavWord;
use crate::time::SECONDS_PER_WEEK;

const PARITY: usize = 60;
const OCTETS: usize = 118;
/// Places of the octets of the words 17 to 20 and 1 to 4 in the polynomial. The first octet of word 1 is known: type 1
/// and the two lowest bits of IODnav.
const PLACES: [std::ops::Range<usize>; 8] =
    [0..15, 15..30, 30..45, 45..60, 61..76, 76..90, 90..104, 104..118];
/// Words are of one issue where the bits of IODnav agree and they come within this time, s: all eight words come in
/// 30 s, the next issue of the same lowest bits not within minutes.
const ISSUE_SPAN_S: f64 = 90.0;

/// Words of one issue of data of a satellite.
#[derive(Clone, Debug)]
pub(super) struct IssueWords {
    octets: [u8; OCTETS],
    received: [bool; 8],
    /// Lowest two bits of IODnav, and all ten where one of the words 1 to 4 has come.
    low: u8,
    iod_nav: Option<u16>,
    /// Time of week, s, that the satellite had stated last when the first word came, or stated next.
    since: Option<f64>,
}

impl IssueWords {
    fn new(low: u8, since: Option<f64>) -> Self {
        let mut octets = [0; OCTETS];
        octets[PARITY] = 1 << 2 | low;
        Self { octets, received: [false; 8], low, iod_nav: None, since }
    }

    /// Takes a word that came about `tow`, s of the week, where that is known, into `issue`, which begins anew with the first word of
    /// another issue. Gives the words 1 to 4 where this word completes them with the help of parity.
    pub(super) fn add(
        issue: &mut Option<Self>,
        word: &InavWord,
        tow: Option<f64>,
    ) -> Option<[InavWord; 4]> {
        let (at, iod_nav) = match word {
            InavWord::Ephemeris1(w) => (4, Ok(w.iod_nav)),
            InavWord::Ephemeris2(w) => (5, Ok(w.iod_nav)),
            InavWord::Ephemeris3(w) => (6, Ok(w.iod_nav)),
            InavWord::Ephemeris4(w) => (7, Ok(w.iod_nav)),
            InavWord::Parity(w) if (17..=20).contains(&w.kind) => {
                (usize::from(w.kind) - 17, Err(w.iod_nav))
            }
            _ => return None,
        };
        let low = iod_nav.map_or_else(|low| low, |all| (all & 3) as u8);
        let belongs = |issue: &Self| {
            let age = |(tow, since): (f64, f64)| (tow - since).rem_euclid(SECONDS_PER_WEEK as f64);
            let is_old = tow.zip(issue.since).map(age).is_some_and(|age| age > ISSUE_SPAN_S);
            let is_other = iod_nav.is_ok_and(|all| issue.iod_nav.is_some_and(|other| other != all));
            issue.low == low && !is_other && !is_old
        };
        let mut words = issue.take().filter(belongs).unwrap_or_else(|| Self::new(low, tow));
        words.iod_nav = iod_nav.ok().or(words.iod_nav);
        words.since = words.since.or(tow);
        let is_new = !words.received[at];
        words.received[at] = true;
        words.octets[PLACES[at].clone()].copy_from_slice(&octets_of(word)?);
        let count = words.received.iter().filter(|&&r| r).count();
        let complete = words.received[4..].iter().all(|&r| r);
        let solved = if is_new && count == 4 && !complete { words.solve() } else { None };
        *issue = Some(words);
        solved
    }

    /// The words 1 to 4, unless the octets that came contradict each other.
    fn solve(&self) -> Option<[InavWord; 4]> {
        let missing: Vec<usize> = PLACES
            .iter()
            .zip(self.received)
            .filter(|(_, r)| !r)
            .flat_map(|(p, _)| p.clone())
            .collect();
        let mut octets = self.octets;
        missing.iter().for_each(|&place| octets[place] = 0);
        // A row: the powers of one root at the missing places, and what the known octets sum to there.
        let mut rows: Vec<Vec<u8>> = (1..=PARITY)
            .map(|root| {
                let known =
                    octets.iter().enumerate().map(|(k, &octet)| times(octet, power(root * k)));
                let sum = known.fold(0, |sum, term| sum ^ term);
                missing.iter().map(|&place| power(root * place)).chain([sum]).collect()
            })
            .collect();
        if !eliminate(&mut rows, missing.len()) {
            return None;
        }
        for (&place, row) in missing.iter().zip(&rows) {
            octets[place] = row[missing.len()];
        }
        Some([0, 1, 2, 3].map(|k| word_of(k, &octets)))
    }
}

/// Gauss-Jordan elimination of rows of `unknowns` coefficients and a sum: the first rows then hold the solution. False
/// where the rows beyond contradict it.
fn eliminate(rows: &mut [Vec<u8>], unknowns: usize) -> bool {
    for column in 0..unknowns {
        let Some(pivot) = (column..rows.len()).find(|&r| rows[r][column] != 0) else {
            return false;
        };
        rows.swap(column, pivot);
        let scale = inverse(rows[column][column]);
        rows[column].iter_mut().for_each(|value| *value = times(*value, scale));
        let lead = rows[column].clone();
        for row in rows.iter_mut().enumerate().filter(|(r, _)| *r != column).map(|(_, row)| row) {
            let factor = row[column];
            row.iter_mut().zip(&lead).for_each(|(value, &l)| *value ^= times(l, factor));
        }
    }
    rows[unknowns..].iter().all(|row| row[unknowns] == 0)
}

/// Octets of a word in the polynomial, in the order of their places.
fn octets_of(word: &InavWord) -> Option<Vec<u8>> {
    if let InavWord::Parity(ParityWord { first, octets, .. }) = word {
        return Some([&[*first][..], octets].concat());
    }
    let bits = word.encode().ok()?;
    let octet = |from: usize| bits[from..from + 8].iter().fold(0, |o, &bit| o << 1 | u8::from(bit));
    let after_iod = (16..128).step_by(8).map(octet);
    // Of word 1 also the eight highest bits of IODnav.
    let before = matches!(word, InavWord::Ephemeris1(_)).then(|| octet(6));
    Some(before.into_iter().chain(after_iod).collect())
}

/// Word 1 to 4, index 0 to 3, of the octets.
fn word_of(index: usize, octets: &[u8; OCTETS]) -> InavWord {
    let own = &octets[PLACES[4 + index].clone()];
    let data = if index == 0 { &own[1..] } else { own };
    let iod_nav = u16::from(octets[PARITY + 1]) << 2 | u16::from(octets[PARITY] & 3);
    let head = (index as u16 + 1) << 10 | iod_nav;
    let mut bits: WordBits = [false; 128];
    let bytes = head.to_be_bytes().into_iter().chain(data.iter().copied());
    for (eight, byte) in bits.chunks_mut(8).zip(bytes) {
        eight.iter_mut().enumerate().for_each(|(k, bit)| *bit = byte >> (7 - k) & 1 == 1);
    }
    InavWord::decode(&bits)
}

/// Powers of alpha from 0 to 254.
static POWERS: [u8; 255] = {
    let mut powers = [1; 255];
    let mut k = 1;
    while k < 255 {
        powers[k] = powers[k - 1] << 1 ^ if powers[k - 1] & 0x80 == 0 { 0 } else { 0x1D };
        k += 1;
    }
    powers
};

/// Logarithms to the base alpha; that of zero, which has none, is 0.
static LOGARITHMS: [u8; 256] = {
    let mut logarithms = [0; 256];
    let mut k = 0;
    while k < 255 {
        logarithms[POWERS[k] as usize] = k as u8;
        k += 1;
    }
    logarithms
};

fn power(exponent: usize) -> u8 {
    POWERS[exponent % 255]
}

fn logarithm(value: u8) -> usize {
    LOGARITHMS[usize::from(value)].into()
}

fn times(a: u8, b: u8) -> u8 {
    if a == 0 || b == 0 { 0 } else { power(logarithm(a) + logarithm(b)) }
}

/// 1 / `value`, which is not zero.
fn inverse(value: u8) -> u8 {
    power(255 - logarithm(value))
}
