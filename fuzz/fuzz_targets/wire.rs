#![no_main]
//! Bytes of any content as a packet of the network: alone, and behind a header and before a checksum that fit.

use libfuzzer_sys::fuzz_target;
use sdr_rx::network::consensus::{Node, NodeOptions};
use sdr_rx::network::info::Average;
use sdr_rx::network::wire::{PacketHeader, decode, encode};
use sdr_rx::network::{Constraints, Graph};

fuzz_target!(|bytes: &[u8]| {
    let header = PacketHeader::new("fuzz", &["a", "b"], 0, 2, 2);
    let graph = Graph::new(2, &[(0, 1)]).expect("two nodes, one link");
    let constraints = Constraints::new(&graph, &[0]).expect("both are in its star");
    let problem = Average { own: vec![1.0, 2.0], rho: 1.0 };
    let mut node = Node::new(0, &constraints, problem, NodeOptions::default()).expect("alpha 1.6");
    if let Ok(message) = decode(bytes, &header) {
        // What was taken for a message is one: said again it is the same.
        assert_eq!(decode(&encode(&header, &message), &header), Ok(message.clone()));
        node.receive(&message);
        node.step();
    }
});
