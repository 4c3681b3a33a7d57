//! Mistakes in the files, each with its message.

use crate::harness::{Network, program};
use std::process::Stdio;

/// The program's message about a node file with `new` in it instead of `old`.
fn message(network: &Network, old: &str, new: &str) -> String {
    let text = std::fs::read_to_string(network.path("2.toml")).unwrap();
    assert!(text.contains(old), "{old}");
    let path = network.path("changed.toml");
    std::fs::write(&path, text.replace(old, new)).unwrap();
    let output = program(&path).arg("--check").output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{new}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn each_mistake_in_a_node_s_file_is_reported_with_its_position_and_what_is_valid() {
    let network = Network::new("mode = 'asynchronous'");
    let cases = [
        ("node = 'N2'", "node = 'X'", "there is no node 'X': the nodes are N0, N1"),
        ("'network.toml'", "'no.toml'", "no.toml"),
        ("'asynchronous'", "'sometimes'", "unknown variant `sometimes`"),
        ("status_ms", "colour = 1\nstatus_ms", "unknown field `colour`"),
        ("status_ms", "loss = 1.0\nstatus_ms", "loss is 1, must be in [0, 1)"),
        (
            "status_ms",
            "relaxation = 2.0\nstatus_ms",
            "relaxation is 2, must be above 0 and below 2",
        ),
        ("status_ms", "lease_ms = 1\nstatus_ms", "lease_ms is 1, must be at least 100"),
        (
            "mode = 'asynchronous'",
            "[security]\nauthority = 'ca.pem'",
            "authority, certificate and key together",
        ),
        ("mode = 'asynchronous'", "[security]\nuser = 'a'", "user and password together"),
        ("mode = 'asynchronous'", "[security]\nusers = 'nobody'", "there is no file"),
    ];
    for (old, new, expected) in cases {
        let message = message(&network, old, new);
        assert!(message.contains(expected), "{new}: {message}");
        assert!(message.contains(".toml"), "{new}: {message}");
    }
}

#[test]
fn a_check_shows_the_engine_s_configuration_with_the_neighbours_only() {
    let network = Network::new("lease_ms = 2500");
    let output = program(&network.path("2.toml")).arg("--check").stdout(Stdio::piped()).output();
    let output = output.unwrap();
    assert!(output.status.success());
    let config: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let address = |k: usize| network.setup.file.node[k].address.clone().unwrap();
    assert_eq!(config["listen"]["endpoints"], serde_json::json!([address(2)]));
    // Of its neighbours 1, 4, 5, 6, 7 the one of smaller number; the others connect to it.
    assert_eq!(config["connect"]["endpoints"], serde_json::json!([address(1)]));
    assert_eq!(config["scouting"]["multicast"]["enabled"], false);
    assert_eq!(config["scouting"]["gossip"]["enabled"], false);
    assert_eq!(config["transport"]["link"]["tx"]["lease"], 2500);
}
