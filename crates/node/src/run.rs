//! The loop of a node: packets in, steps of the library's state machine, packets out.

use crate::config::Setup;
use crate::engine::{Address, Engine, Event};
use crate::status::{Log, Packets, Schedule, StatusRecord};
use anyhow::Result;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sdr_rx_network::consensus::{NodeOptions, Received, Rule};
use sdr_rx_network::message::Body;
use sdr_rx_network::sim::Participant;
use sdr_rx_network::station::Station;
use sdr_rx_network::wire::{self, PacketHeader};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Synchronous: time without progress after which everything is sent again.
const PATIENCE: Duration = Duration::from_millis(200);
/// Maximum time until a request to end is noticed.
const NAP: Duration = Duration::from_millis(50);

/// A node, its neighbours, and the packets received.
pub struct Member<'a> {
    setup: &'a Setup,
    header: PacketHeader,
    station: Station,
    round: u64,
    live: BTreeSet<usize>,
    packets: Packets,
    /// The sequence number of the last packet to each destination.
    sent: BTreeMap<Address, u64>,
    random: ChaCha8Rng,
    start: Instant,
}

impl<'a> Member<'a> {
    /// A node without prior estimate.
    pub fn new(setup: &'a Setup) -> Result<Self> {
        let network = &setup.network;
        let rule = if setup.is_synchronous() { Rule::Synchronous } else { Rule::Acknowledged };
        let now = SystemTime::now().duration_since(UNIX_EPOCH)?;
        let first_sequence = now.as_nanos() as u64;
        let options = NodeOptions { relaxation: setup.relaxation(), rule, first_sequence };
        let model = network.model(setup.id)?;
        let station = Station::new(setup.id, &network.agreement, model, options)?;
        let (name, parameters) = (&network.file.name, &network.file.parameters);
        let numbers = station.estimate().len();
        let nodes = network.file.node.len();
        Ok(Self {
            header: PacketHeader::new(name, parameters, setup.file.epoch, nodes, numbers),
            setup,
            station,
            round: 0,
            live: BTreeSet::new(),
            packets: Packets::default(),
            sent: BTreeMap::new(),
            random: ChaCha8Rng::seed_from_u64(first_sequence),
            start: Instant::now(),
        })
    }

    /// The longest packet of the network.
    pub fn longest_packet(&self) -> usize {
        self.header.longest()
    }

    /// Works until `stop` is set.
    pub fn run(&mut self, engine: &mut Engine, log: &mut Log, stop: &AtomicBool) -> Result<()> {
        let mut schedule = Schedule::new(Duration::from_millis(self.setup.file.status_ms));
        let synchronous = self.setup.is_synchronous();
        let (mut next_move, mut progress) = (Instant::now(), Instant::now());
        let mut waiting = synchronous;
        while !stop.load(Ordering::Relaxed) {
            let until = next_move.saturating_duration_since(Instant::now());
            let wait = if until.is_zero() { NAP } else { until.min(NAP) };
            let came_up = self.take_in(engine, wait);
            waiting &= self.missing().next().is_some();
            let resting = self.setup.file.rounds.is_some_and(|rounds| self.round >= rounds);
            let now = Instant::now();
            let due = now >= next_move && !waiting;
            if due && !resting && self.station.step() {
                self.round += 1;
                progress = now;
                next_move = now + self.setup.pace();
            }
            let stalled = now.saturating_duration_since(progress) > PATIENCE;
            if stalled {
                progress = now;
            }
            if due && !synchronous {
                next_move = now + self.setup.pace();
            }
            if !waiting {
                self.speak(engine, came_up || stalled || (due && !synchronous))?;
            }
            if schedule.due(self.start.elapsed()) {
                let doing = if resting { "resting" } else { "running" };
                log.write(&self.record(if waiting { "waiting" } else { doing }))?;
            }
        }
        log.write(&self.record("ended"))
    }

    /// Takes all that has come, after waiting for the first of it; whether a neighbour came up.
    fn take_in(&mut self, engine: &Engine, wait: Duration) -> bool {
        let first = engine.events().recv_timeout(wait).ok();
        let rest = std::iter::from_fn(|| engine.events().try_recv().ok());
        let mut came_up = false;
        for event in first.into_iter().chain(rest) {
            match event {
                Event::Packet(packet) => self.receive(&packet),
                Event::Up(node) if self.setup.neighbours().any(|k| k == node) => {
                    came_up |= self.live.insert(node);
                }
                Event::Up(_) => {}
                Event::Down(node) => _ = self.live.remove(&node),
            }
        }
        came_up
    }

    fn receive(&mut self, packet: &[u8]) {
        let packets = &mut self.packets;
        if self.setup.file.loss > 0.0 && self.random.random_bool(self.setup.file.loss) {
            packets.lost += 1;
            return;
        }
        match wire::decode(packet, &self.header) {
            Ok(message) => match self.station.receive(&message) {
                Received::Taken => packets.taken += 1,
                Received::Old => packets.old += 1,
                Received::Foreign => packets.foreign += 1,
            },
            Err(reason) => *packets.refused.entry(reason).or_default() += 1,
        }
    }

    /// Sends what is new, or everything.
    fn speak(&mut self, engine: &mut Engine, everything: bool) -> Result<()> {
        let mut star_is_done = false;
        for (neighbour, message) in self.station.messages() {
            let to = match message.body {
                Body::Consensus { .. } => Address::Star,
                Body::State { .. } | Body::PartialSum { .. } => Address::Neighbour(neighbour),
            };
            let done = to == Address::Star && std::mem::replace(&mut star_is_done, true);
            let new = self.sent.get(&to) != Some(&message.sequence);
            if !done && (new || everything) {
                self.sent.insert(to, message.sequence);
                engine.send(to, wire::encode(&self.header, &message))?;
            }
        }
        Ok(())
    }

    fn missing(&self) -> impl Iterator<Item = usize> {
        self.setup.neighbours().filter(|node| !self.live.contains(node))
    }

    fn record<'s>(&'s self, state: &'s str) -> StatusRecord<'s> {
        let estimate = self.station.read().ok().filter(|_| self.round > 0);
        let residuals = self.station.residuals();
        let solution = estimate.as_ref().and_then(|estimate| estimate.solution());
        StatusRecord {
            node: self.setup.id,
            name: &self.setup.file.node,
            state,
            elapsed_s: self.start.elapsed().as_secs_f64(),
            round: self.round,
            sigma: solution.map(|solution| solution.sigma().as_slice().to_vec()),
            x: estimate.as_ref().map(|estimate| estimate.x().as_slice().to_vec()),
            primal: residuals.primal,
            dual: residuals.dual,
            settled: self.station.settled(),
            named: self.station.named(),
            excluded: self.station.excluded(),
            live: &self.live,
            missing: self.missing().collect(),
            packets: &self.packets,
        }
    }
}
