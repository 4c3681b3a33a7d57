//! Messages as bytes, for transports between processes.
//!
//! A packet is, all numbers little-endian: the magic `SDRN`, version (2 bytes), network, parameters and epoch
//! (8 bytes each), the [`NodeMessage`] in the postcard format, and a checksum (8 bytes) of all before it. What does
//! not fit the receiver's own [`PacketHeader`] is refused with a reason, and has no effect.
//!
//! The checksum is FNV-1a of 64 bits, in which one changed byte always shows, at any position. It
//! detects damage, not forgery: authentication is left to the transport.

use super::message::{Body, NodeMessage};
use serde::Serialize;

const MAGIC: [u8; 4] = *b"SDRN";
const VERSION: u16 = 1;
/// Magic, version, network, parameters, epoch.
const PREFIX: usize = 4 + 2 + 3 * 8;
const CHECKSUM: usize = 8;
/// A message without its lists: sender (5), sequence (10), kind (1), two lengths (10 each), calm (5), whether
/// there is a suspect (1), its statistic (8), node, observation and age (5 each).
const MESSAGE: usize = 5 + 10 + 1 + 2 * 10 + 5 + 1 + 8 + 3 * 5;
/// The number of a node (5) and of its state (10).
const ACKNOWLEDGED: usize = 5 + 10;

/// Header of all messages of one network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketHeader {
    network: u64,
    parameters: u64,
    epoch: u64,
    nodes: usize,
    numbers: usize,
}

impl PacketHeader {
    /// The header of a network of `nodes` nodes, which estimates these parameters at this epoch, and whose
    /// messages carry `numbers` numbers each.
    pub fn new<S: AsRef<str>>(
        network: &str,
        parameters: &[S],
        epoch: u64,
        nodes: usize,
        numbers: usize,
    ) -> Self {
        // 0xff is in no UTF-8 text: the lists ["ab"] and ["a", "b"] differ.
        let end = |hash| fnv(hash, &[0xff]);
        let add = |hash, name: &S| end(fnv(hash, name.as_ref().as_bytes()));
        let parameters = parameters.iter().fold(FNV_START, add);
        Self { network: fnv(FNV_START, network.as_bytes()), parameters, epoch, nodes, numbers }
    }

    /// The longest packet, in bytes.
    pub fn longest(&self) -> usize {
        PREFIX + MESSAGE + ACKNOWLEDGED * self.nodes + 8 * self.numbers + CHECKSUM
    }

    fn prefix(&self) -> Vec<u8> {
        let ids = [self.network, self.parameters, self.epoch].map(u64::to_le_bytes);
        [&MAGIC[..], &VERSION.to_le_bytes(), ids.as_flattened()].concat()
    }
}

/// Why a packet is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Refused {
    /// Longer than any message of this network.
    #[error("longer than any message of this network")]
    TooLong,
    /// Not of this program.
    #[error("not a message of sdr-rx: it does not begin with SDRN")]
    NotOurs,
    /// Of another version.
    #[error("of another version of sdr-rx, not of {VERSION}")]
    OtherVersion,
    /// Of a network of another name.
    #[error("of a network of another name")]
    OtherNetwork,
    /// Of a network with other parameters.
    #[error("of a network of other parameters")]
    OtherParameters,
    /// Of another epoch.
    #[error("of another epoch")]
    OtherEpoch,
    /// Cut short or changed on its way.
    #[error("damaged: the checksum does not fit")]
    Damaged,
    /// Whole, but not a message of this network: numbers too many, too few or not finite.
    #[error("malformed: not a message of finite numbers as many as this network needs")]
    Malformed,
}

/// A message as bytes.
pub fn encode(header: &PacketHeader, message: &NodeMessage) -> Vec<u8> {
    // Postcard fails on lists of unknown length only; a message has none.
    let mut packet = postcard::to_extend(message, header.prefix()).unwrap_or_default();
    let sum = fnv(FNV_START, &packet);
    packet.extend(sum.to_le_bytes());
    packet
}

/// The message that these bytes are, for a receiver of this header.
///
/// # Errors
/// [`Refused`]. Any bytes may be given; no more memory is taken than the longest message needs.
pub fn decode(packet: &[u8], expected: &PacketHeader) -> Result<NodeMessage, Refused> {
    if packet.len() > expected.longest() {
        return Err(Refused::TooLong);
    }
    let own = expected.prefix();
    let fields = [
        (0..4, Refused::NotOurs),
        (4..6, Refused::OtherVersion),
        (6..14, Refused::OtherNetwork),
        (14..22, Refused::OtherParameters),
        (22..30, Refused::OtherEpoch),
    ];
    for (position, reason) in fields {
        match packet.get(position.clone()) {
            Some(found) if *found == own[position] => {}
            Some(_) => return Err(reason),
            None if packet.starts_with(&MAGIC) => return Err(Refused::Damaged),
            None => return Err(Refused::NotOurs),
        }
    }
    let (content, sum) = packet.split_last_chunk::<CHECKSUM>().ok_or(Refused::Damaged)?;
    if content.len() < PREFIX || fnv(FNV_START, content).to_le_bytes() != *sum {
        return Err(Refused::Damaged);
    }
    let decoded = postcard::take_from_bytes::<NodeMessage>(&content[PREFIX..]);
    let (message, rest) = decoded.map_err(|_| Refused::Malformed)?;
    let fits = rest.is_empty() && well_formed(&message, expected);
    fits.then_some(message).ok_or(Refused::Malformed)
}

fn well_formed(message: &NodeMessage, expected: &PacketHeader) -> bool {
    let (numbers, acknowledged) = match &message.body {
        Body::State { t } => (t, 0),
        Body::Consensus { acknowledged, z } => (z, acknowledged.len()),
        Body::PartialSum { sum } => (sum, 0),
    };
    let node = |number: u32| (number as usize) < expected.nodes;
    let suspect = message.news.suspect;
    node(message.sender)
        && acknowledged <= expected.nodes
        && numbers.len() == expected.numbers
        && numbers.iter().all(|number| number.is_finite())
        && suspect.is_none_or(|suspect| node(suspect.node) && suspect.statistic.is_finite())
}

const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a (Fowler, Noll, Vo) of 64 bits, continued from `hash`.
fn fnv(hash: u64, bytes: &[u8]) -> u64 {
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(hash, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consensus::{Node, NodeOptions, Received};
    use crate::info::Average;
    use crate::message::{News, Suspect};
    use crate::{Constraints, Graph};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const NUMBERS: usize = 3;
    const NODES: usize = 3;

    fn header() -> PacketHeader {
        PacketHeader::new("test", &["a", "b", "c"], 7, NODES, NUMBERS)
    }

    /// The largest message that there can be, and one of each other kind.
    fn messages() -> [NodeMessage; 3] {
        let suspect =
            Suspect { statistic: f64::MAX, node: 2, observation: u32::MAX, age: u32::MAX };
        let acknowledged = vec![(u32::MAX, u64::MAX); NODES];
        let z = vec![f64::MIN; NUMBERS];
        let t = vec![-0.0, 1e-300, 3.5];
        let message = |sequence, body, news| NodeMessage { sender: 2, sequence, body, news };
        [
            message(
                u64::MAX,
                Body::Consensus { acknowledged, z },
                News { calm: u32::MAX, suspect: Some(suspect) },
            ),
            message(0, Body::State { t }, News::default()),
            message(5, Body::PartialSum { sum: vec![1.0; NUMBERS] }, News::default()),
        ]
    }

    /// With a valid checksum.
    fn seal(mut content: Vec<u8>) -> Vec<u8> {
        let sum = fnv(FNV_START, &content);
        content.extend(sum.to_le_bytes());
        content
    }

    #[test]
    fn what_is_encoded_is_decoded_bit_for_bit_and_no_message_is_longer_than_the_longest() {
        for message in messages() {
            let packet = encode(&header(), &message);
            assert!(packet.len() <= header().longest());
            assert_eq!(decode(&packet, &header()), Ok(message));
        }
    }

    #[test]
    fn every_truncation_and_every_flipped_bit_is_refused() {
        for message in messages() {
            let packet = encode(&header(), &message);
            for length in 0..packet.len() {
                let reason = decode(&packet[..length], &header()).unwrap_err();
                assert_eq!(reason, if length < 4 { Refused::NotOurs } else { Refused::Damaged });
            }
            for bit in 0..8 * packet.len() {
                let mut flipped = packet.clone();
                flipped[bit / 8] ^= 1 << (bit % 8);
                decode(&flipped, &header()).unwrap_err();
            }
            let longer = [&packet[..], &[0]].concat();
            assert_eq!(decode(&longer, &header()), Err(Refused::Damaged));
        }
    }

    #[test]
    fn each_foreign_packet_is_refused_for_its_own_reason() {
        let [_, message, _] = messages();
        let from = |header: PacketHeader| decode(&encode(&header, &message), &self::header());
        let made = |name, parameters: &[&str], epoch| {
            PacketHeader::new(name, parameters, epoch, NODES, NUMBERS)
        };
        let names = ["a", "b", "c"];
        assert_eq!(from(made("other", &names, 7)), Err(Refused::OtherNetwork));
        assert_eq!(from(made("test", &["ab", "c"], 7)), Err(Refused::OtherParameters));
        assert_eq!(from(made("test", &names, 8)), Err(Refused::OtherEpoch));
        let packet = encode(&header(), &message);
        let mut newer = packet[..packet.len() - CHECKSUM].to_vec();
        newer[4] += 1;
        assert_eq!(decode(&seal(newer), &header()), Err(Refused::OtherVersion));
        assert_eq!(decode(&vec![0; header().longest() + 1], &header()), Err(Refused::TooLong));
        assert_eq!(decode(b"GET / HTTP/1.1", &header()), Err(Refused::NotOurs));
    }

    #[test]
    fn whole_packets_of_wrong_content_are_refused() {
        let [_, message, _] = messages();
        let refused = |change: &dyn Fn(&mut NodeMessage)| {
            let mut changed = message.clone();
            change(&mut changed);
            decode(&encode(&header(), &changed), &header()) == Err(Refused::Malformed)
        };
        let state = |t: &[f64]| Body::State { t: t.to_vec() };
        let suspect = |node, statistic| Some(Suspect { statistic, node, observation: 0, age: 0 });
        assert!(!refused(&|m| m.body = state(&[0.0; NUMBERS])));
        assert!(!refused(&|m| m.news.suspect = suspect(0, 1.0)));
        assert!(refused(&|m| m.body = state(&[0.0; NUMBERS - 1])));
        assert!(refused(&|m| m.body = state(&[0.0; NUMBERS + 1])));
        assert!(refused(&|m| m.sender = NODES as u32));
        assert!(refused(&|m| m.news.suspect = suspect(NODES as u32, 1.0)));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(refused(&|m| m.body = state(&[0.0, bad, 0.0])));
            assert!(refused(&|m| m.news.suspect = suspect(0, bad)));
        }
        // A state whose list claims to hold 2^60 numbers.
        let claim = [&header().prefix()[..], &[2, 0, 0], &[0x80; 8], &[0x10]].concat();
        assert_eq!(decode(&seal(claim), &header()), Err(Refused::Malformed));
    }

    type Nodes = Vec<Node<Average>>;

    /// A path of three nodes whose middle is the constraint node.
    fn nodes() -> Nodes {
        let graph = Graph::new(NODES, &[(0, 1), (1, 2)]).unwrap();
        let constraints = Constraints::new(&graph, &[1]).unwrap();
        let node = |id| {
            let own = (0..NUMBERS).map(|k| (id * 5 + k) as f64).collect();
            let problem = Average { own, rho: 1.0 };
            Node::new(id, &constraints, problem, NodeOptions::default()).unwrap()
        };
        (0..NODES).map(node).collect()
    }

    fn exchange_packets(nodes: &mut Nodes) {
        let sent: Vec<_> = nodes.iter().flat_map(Node::messages).collect();
        for (to, message) in sent {
            let packet = encode(&header(), &message);
            nodes[to].receive(&decode(&packet, &header()).unwrap());
        }
        nodes.iter_mut().for_each(|node| _ = node.step());
    }

    /// A packet that must have no effect: noise, a header with noise behind it, or a genuine packet with a few
    /// bytes changed, cut off, or of another network.
    fn worthless(genuine: &[Vec<u8>], rng: &mut ChaCha8Rng) -> Vec<u8> {
        let noise = |rng: &mut ChaCha8Rng| {
            let length = rng.random_range(0..header().longest() + 20);
            (0..length).map(|_| rng.random()).collect::<Vec<u8>>()
        };
        let mut packet = genuine[rng.random_range(0..genuine.len())].clone();
        match rng.random_range(0..5) {
            0 => return noise(rng),
            1 => return seal([header().prefix(), noise(rng)].concat()),
            2 => packet.truncate(rng.random_range(0..packet.len())),
            3 => {
                packet.truncate(packet.len() - CHECKSUM);
                packet[rng.random_range(0..PREFIX)] ^= rng.random_range(1..=255u8);
                return seal(packet);
            }
            _ => {}
        }
        for _ in 0..rng.random_range(1..8) {
            let position = rng.random_range(0..packet.len().max(1));
            if let Some(byte) = packet.get_mut(position) {
                *byte ^= rng.random_range(1..=255u8);
            }
        }
        if genuine.contains(&packet) {
            packet.pop();
        }
        packet
    }

    /// A genuine packet whose message was changed with a valid format: it may be accepted.
    fn forged(genuine: &[Vec<u8>], rng: &mut ChaCha8Rng) -> Vec<u8> {
        let packet = &genuine[rng.random_range(0..genuine.len())];
        let mut content = packet[..packet.len() - CHECKSUM].to_vec();
        for _ in 0..rng.random_range(1..4) {
            let position = rng.random_range(PREFIX..content.len());
            content[position] = rng.random();
        }
        seal(content)
    }

    /// Exchanges between nodes that also receive `packets` bad packets, beside nodes that do not.
    fn assault(packets: usize, seed: u64) {
        const ROUNDS: usize = 40;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut assaulted, mut in_peace) = (nodes(), nodes());
        let mut taken = 0;
        for _ in 0..ROUNDS {
            let sent = assaulted.iter().flat_map(Node::messages);
            let genuine: Vec<_> = sent.map(|(_, message)| encode(&header(), &message)).collect();
            for _ in 0..packets / ROUNDS {
                let node = &mut assaulted[rng.random_range(0..NODES)];
                if rng.random_bool(0.5) {
                    let packet = worthless(&genuine, &mut rng);
                    if let Ok(message) = decode(&packet, &header()) {
                        assert_ne!(node.receive(&message), Received::Taken, "{packet:?}");
                    }
                } else if let Ok(message) = decode(&forged(&genuine, &mut rng), &header()) {
                    let mut victim = node.clone();
                    match victim.receive(&message) {
                        Received::Taken => taken += usize::from(victim.step()),
                        Received::Old | Received::Foreign => _ = node.receive(&message),
                    }
                }
            }
            exchange_packets(&mut assaulted);
            exchange_packets(&mut in_peace);
        }
        let bits = |nodes: &Nodes| -> Vec<u64> {
            nodes.iter().flat_map(|node| node.estimate()).map(|x| x.to_bits()).collect()
        };
        assert_eq!(bits(&assaulted), bits(&in_peace));
        let messages = |nodes: &Nodes| nodes.iter().map(Node::messages).collect::<Vec<_>>();
        assert_eq!(messages(&assaulted), messages(&in_peace));
        assert!(taken > 0, "no forged packet got as far as the node's arithmetic");
    }

    #[test]
    fn a_hundred_thousand_worthless_or_forged_packets_cause_no_panic_and_have_no_effect() {
        assault(100_000, 1);
    }

    #[test]
    #[ignore = "ten million packets take minutes"]
    fn ten_million_worthless_or_forged_packets_cause_no_panic_and_have_no_effect() {
        assault(10_000_000, 2);
    }
}
