//! Packets to and from the neighbours, by zenoh.
//!
//! Peers with the addresses of their neighbours, without a router. The keys of a network `NET` are `NET/z/S` for
//! messages of constraint node S to its star, `NET/up/S/I` for messages of node I to its neighbour S, and
//! `NET/live/I`, a token that exists as long as node I is connected.

use anyhow::{Result, anyhow};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::sample::{Sample, SampleKind};

/// Maximum number of packets kept for a node that does not keep up.
const WAITING_PACKETS: usize = 4096;

/// Input from a neighbour.
#[derive(Debug)]
pub(crate) enum Event {
    /// Bytes on one of our keys.
    Packet(Vec<u8>),
    /// A node connected.
    Up(usize),
    /// A node fell silent or closed its connection.
    Down(usize),
}

/// Destination of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Address {
    /// All neighbours of this node.
    Star,
    /// A neighbour.
    Neighbour(usize),
}

/// An open connection to the neighbours, closed when dropped.
#[derive(Debug)]
pub(crate) struct Engine {
    network: String,
    id: usize,
    session: zenoh::Session,
    events: Receiver<Event>,
    publishers: BTreeMap<Address, Publisher<'static>>,
    _subscribers: Vec<Subscriber<()>>,
    /// Declared last: a node that receives it can rely on this node's subscriptions.
    _token: LivelinessToken,
}

impl Engine {
    /// Opens the connection of node `id` and listens to the stars of `hubs`.
    pub fn open(config: zenoh::Config, network: &str, id: usize, hubs: &[usize]) -> Result<Self> {
        let session = zenoh::open(config).wait().map_err(failed("open the connection"))?;
        let (sender, events) = sync_channel(WAITING_PACKETS);
        let mut subscribers = vec![subscribe(&session, &format!("{network}/up/{id}/*"), &sender)?];
        for hub in hubs {
            subscribers.push(subscribe(&session, &format!("{network}/z/{hub}"), &sender)?);
        }
        let heard = move |sample: Sample| {
            let number = sample.key_expr().as_str().rsplit('/').next().and_then(|n| n.parse().ok());
            let event = match sample.kind() {
                SampleKind::Put => Event::Up,
                SampleKind::Delete => Event::Down,
            };
            // The receiver is gone only while the program ends.
            number.into_iter().for_each(|number| _ = sender.send(event(number)));
        };
        let liveliness = session.liveliness();
        let live = liveliness.declare_subscriber(format!("{network}/live/*")).history(true);
        subscribers.push(live.callback(heard).wait().map_err(failed("watch the neighbours"))?);
        let token = liveliness.declare_token(format!("{network}/live/{id}")).wait();
        Ok(Self {
            network: network.into(),
            id,
            _token: token.map_err(failed("announce this node"))?,
            session,
            events,
            publishers: BTreeMap::new(),
            _subscribers: subscribers,
        })
    }

    /// What came in, in its order.
    pub fn events(&self) -> &Receiver<Event> {
        &self.events
    }

    /// Sends a packet; it is dropped rather than waited for when a neighbour does not take it in.
    pub fn send(&mut self, to: Address, packet: Vec<u8>) -> Result<()> {
        let publisher = match self.publishers.entry(to) {
            std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::btree_map::Entry::Vacant(new) => {
                let key = match to {
                    Address::Star => format!("{}/z/{}", self.network, self.id),
                    Address::Neighbour(hub) => format!("{}/up/{hub}/{}", self.network, self.id),
                };
                let builder = self.session.declare_publisher(key);
                let builder = builder.congestion_control(CongestionControl::Drop).express(true);
                new.insert(builder.wait().map_err(failed("declare a key"))?)
            }
        };
        publisher.put(packet).wait().map_err(failed("send"))
    }
}

fn subscribe(
    session: &zenoh::Session,
    key: &str,
    sender: &SyncSender<Event>,
) -> Result<Subscriber<()>> {
    let sender = sender.clone();
    let take = move |sample: Sample| {
        // Without room the packet is lost, as on a bad link: it will be sent again.
        _ = sender.try_send(Event::Packet(sample.payload().to_bytes().into_owned()));
    };
    session.declare_subscriber(key).callback(take).wait().map_err(failed("listen"))
}

fn failed(doing: &str) -> impl Fn(zenoh::Error) -> anyhow::Error + '_ {
    move |error| anyhow!("the messaging engine could not {doing}: {error}")
}
