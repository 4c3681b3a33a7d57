//! ION GNSS SDR metadata: the part that describes one chunk of words repeated to the end of a file.
//!
//! A lane (a file) holds blocks of chunks of words; a chunk holds lumps, a lump streams, and a stream
//! the samples of a band. Only the bits of the chosen streams are decoded.

use super::error::wrong;
use super::file_source::Description;
use super::ion_bits::{Order, Stream, byte_order, place_streams};
use super::lane::Data;
use super::{CaptureError, Note, OpenOptions, Packing, SampleFormat};
use crate::gnss::GpsTime;
use crate::gnss::signal::L1_CENTRE_HZ;
use roxmltree::{Document, Node};
use std::path::{Path, PathBuf};

/// A lane: what one file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// Its name.
    pub id: String,
    /// Name of its data file, where one is stated.
    pub url: Option<String>,
    /// Bytes before the first chunk.
    pub header_bytes: u64,
    /// Chunks and base rates a second, Hz: a stream has `ratefactor` samples for each.
    pub freqbase_hz: f64,
    /// Positions of a chunk's bytes from the least significant up.
    pub byte_order: Vec<usize>,
    /// Its streams, placed in the chunk.
    pub streams: Vec<Stream>,
    /// Times that the session and the file state for the first sample, as text.
    pub times: Vec<String>,
}

/// Parses ION metadata into lanes; `path` is for messages only.
///
/// # Errors
/// [`CaptureError::Metadata`] with line and column where the XML is malformed,
/// [`CaptureError::MetadataValue`] where a value is missing, wrong or of a kind that is not read.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Lane>, CaptureError> {
    let xml = text.trim_start_matches('\u{feff}').trim_start();
    let before = text[..text.len() - xml.len()].matches('\n').count();
    let document = Document::parse(xml).map_err(|e| CaptureError::Metadata {
        path: path.to_owned(),
        line: before + e.pos().row as usize,
        column: e.pos().col as usize,
        reason: format!("no ION metadata: {e}"),
    })?;
    let reader = Reader { path, root: document.root_element() };
    let lanes = reader.children(reader.root, "lane");
    lanes.map(|lane| reader.lane(lane)).collect()
}

/// Describes the capture whose metadata are at `path`; `data` replaces the files that they name.
pub(super) fn describe(
    path: &Path,
    data: &[PathBuf],
    options: &OpenOptions,
) -> Result<Description, CaptureError> {
    let bytes =
        std::fs::read(path).map_err(|cause| CaptureError::Open { path: path.to_owned(), cause })?;
    let mut lanes = parse(&String::from_utf8_lossy(&bytes), path)?;
    let offered: Vec<String> =
        lanes.iter().flat_map(|l| l.streams.iter().map(|s| s.id.clone())).collect();
    for lane in &mut lanes {
        let lane_id = lane.id.clone();
        lane.streams.retain(|s| match &options.stream {
            Some(asked) => *asked == s.id || *asked == lane_id,
            None => (s.center_hz - L1_CENTRE_HZ).abs() <= s.bandwidth_hz / 2.0,
        });
    }
    lanes.retain(|l| !l.streams.is_empty());
    let offered = offered.join(", ");
    let [first, ..] = &lanes[..] else {
        let asked = options.stream.as_deref().unwrap_or("a stream of GPS L1 (1575.42 MHz)");
        return Err(wrong(path, asked, format!("is not among its streams: {offered}")));
    };
    let mut notes = Vec::new();
    let files = if data.is_empty() {
        named_files(path, &lanes)?
    } else if data.len() <= lanes.len() {
        data.to_vec()
    } else {
        let reason = format!("{} data files are given for {} lanes", data.len(), lanes.len());
        return Err(wrong(path, "files", reason));
    };
    let chosen = &lanes[..files.len()];
    if let Some(other) = chosen.iter().find(|l| !l.agrees_with(first)) {
        return Err(CaptureError::StreamsDiffer {
            path: path.to_owned(),
            field: format!("lane '{}'", other.id),
            reason: format!("has another rate, word or coding than lane '{}'", first.id),
        });
    }
    let streams: Vec<&str> =
        chosen.iter().flat_map(|l| l.streams.iter().map(|s| s.id.as_str())).collect();
    if streams.join(", ") != offered {
        notes.push(Note::Streams { read: streams.join(" and "), offered });
    }
    let stream = &first.streams[0];
    let (start_time, time_note) = start_time(first, path)?;
    notes.extend(time_note);
    let parts = files.iter().map(|f| Ok(Data::whole(f)?.part(first.header_bytes, None)));
    Ok(Description {
        format: Some(first.format(path)?),
        rate_hz: Some(first.freqbase_hz * stream.ratefactor as f64),
        if_hz: Some(carrier_if(stream.center_hz, stream.translated_hz)),
        channels_per_file: Some(first.streams.len()),
        start_time,
        array: None,
        data: parts.collect::<Result<_, CaptureError>>()?,
        notes,
    })
}

/// Where the L1 carrier lies: `centerfreq` lies at `translatedfreq`, and L1 as far from it
/// as on the air. Some recorders state in `centerfreq` what lies at 0 Hz, and in `translatedfreq` the
/// carrier itself; then `translatedfreq` equals L1 - `centerfreq`, and is the answer.
fn carrier_if(center_hz: f64, translated_hz: f64) -> f64 {
    let off_center = L1_CENTRE_HZ - center_hz;
    let is_carrier = (translated_hz - off_center).abs() < 1.0;
    if is_carrier { translated_hz } else { translated_hz + off_center }
}

fn start_time(lane: &Lane, path: &Path) -> Result<(Option<GpsTime>, Option<Note>), CaptureError> {
    let Some(text) = lane.times.first() else { return Ok((None, None)) };
    let time = text.parse().map_err(|e| wrong(path, "toa or timestamp", format!("{e}")))?;
    let other = lane.times.iter().find(|t| t.parse() != Ok(time));
    let note = other.map(|other| Note::TwoTimes {
        path: path.to_owned(),
        taken: text.clone(),
        other: other.clone(),
    });
    Ok((Some(time), note))
}

/// The data files that the metadata name, beside the metadata.
fn named_files(path: &Path, lanes: &[Lane]) -> Result<Vec<PathBuf>, CaptureError> {
    let named = lanes.iter().map(|lane| {
        let url = lane.url.as_ref().ok_or_else(|| {
            let reason = "names no data file: give it after the metadata file";
            wrong(path, &format!("lane '{}'", lane.id), reason)
        })?;
        let data = path.with_file_name(url.strip_prefix("file://").unwrap_or(url));
        if data.exists() {
            Ok(data)
        } else {
            Err(CaptureError::MissingData { metadata: path.to_owned(), data })
        }
    });
    named.collect()
}

impl Lane {
    /// Whether the files of both can be read as channels of one capture.
    fn agrees_with(&self, other: &Self) -> bool {
        let same_stream = |(a, b): (&Stream, &Stream)| {
            (a.ratefactor, a.center_hz, a.translated_hz, &a.samples, a.bits, a.encoding)
                == (b.ratefactor, b.center_hz, b.translated_hz, &b.samples, b.bits, b.encoding)
        };
        self.byte_order == other.byte_order
            && self.freqbase_hz == other.freqbase_hz
            && self.header_bytes == other.header_bytes
            && self.streams.len() == other.streams.len()
            && self.streams.iter().zip(&other.streams).all(same_stream)
    }

    /// The streams' samples side by side as one packed format.
    pub fn format(&self, path: &Path) -> Result<SampleFormat, CaptureError> {
        let field = format!("lane '{}'", self.id);
        let first = self.streams.first().ok_or_else(|| wrong(path, &field, "has no stream"))?;
        let alike = |s: &Stream| {
            (s.ratefactor, s.bits, s.encoding, s.translated_hz)
                == (first.ratefactor, first.bits, first.encoding, first.translated_hz)
        };
        if !self.streams.iter().all(alike) {
            let (path, reason) = (path.to_owned(), "has streams that differ".to_owned());
            return Err(CaptureError::StreamsDiffer { path, field, reason });
        }
        let samples = (0..first.ratefactor)
            .flat_map(|k| self.streams.iter().map(move |s| s.samples[k]))
            .collect();
        let packing = Packing::new(self.byte_order.clone(), first.bits, first.encoding, samples)
            .ok_or_else(|| wrong(path, &field, "its samples lie outside of its chunk"))?;
        let kind = if packing.is_real() { "real" } else { "I and Q" };
        let name = format!("ion {kind}, {}-bit {:?}", first.bits, first.encoding);
        Ok(SampleFormat::packed(&name, packing))
    }
}

/// Looks up elements and values.
struct Reader<'a> {
    path: &'a Path,
    root: Node<'a, 'a>,
}

impl<'a> Reader<'a> {
    fn children(
        &self,
        node: Node<'a, 'a>,
        tag: &'static str,
    ) -> impl Iterator<Item = Node<'a, 'a>> {
        node.children().filter(move |n| n.has_tag_name_any(tag))
    }

    /// The one child of this name.
    fn only(&self, node: Node<'a, 'a>, tag: &'static str) -> Result<Node<'a, 'a>, CaptureError> {
        let mut all = self.children(node, tag);
        match (all.next(), all.next()) {
            (Some(one), None) => Ok(one),
            (None, _) => Err(self.wrong(node, tag, "is missing")),
            _ => Err(self.wrong(node, tag, "more than one is not supported")),
        }
    }

    /// An element by reference: itself if it has content, else the root's of the same name and id.
    fn resolve(&self, node: Node<'a, 'a>) -> Result<Node<'a, 'a>, CaptureError> {
        if node.children().any(|n| n.is_element()) {
            return Ok(node);
        }
        let name = node.tag_name().name();
        let is_same =
            |n: &Node| n.tag_name().name() == name && n.attribute("id") == node.attribute("id");
        let defined = self.root.children().find(is_same).filter(|n| *n != node);
        defined.ok_or_else(|| self.wrong(node, "id", "is nowhere defined"))
    }

    fn text(&self, node: Node<'a, 'a>, tag: &'static str) -> Option<&'a str> {
        self.children(node, tag).next()?.text().map(str::trim).filter(|t| !t.is_empty())
    }

    fn integer(
        &self,
        node: Node<'a, 'a>,
        tag: &'static str,
        default: Option<u64>,
    ) -> Result<u64, CaptureError> {
        match (self.text(node, tag), default) {
            (Some(text), _) => text
                .parse()
                .map_err(|_| self.wrong(node, tag, &format!("'{text}' is no whole number"))),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(self.wrong(node, tag, "is missing")),
        }
    }

    /// A frequency with its unit in attribute `format`, Hz.
    fn frequency(
        &self,
        node: Node<'a, 'a>,
        tag: &'static str,
    ) -> Result<Option<f64>, CaptureError> {
        let Some(text) = self.text(node, tag) else { return Ok(None) };
        let unit = self.children(node, tag).next().and_then(|n| n.attribute("format"));
        let scale = match unit.unwrap_or("Hz") {
            "Hz" => 1.0,
            "kHz" => 1e3,
            "MHz" => 1e6,
            "GHz" => 1e9,
            other => {
                return Err(self.wrong(node, tag, &format!("unit '{other}': Hz, kHz, MHz, GHz")));
            }
        };
        let value = text.parse::<f64>().ok().filter(|f| f.is_finite());
        let value =
            value.ok_or_else(|| self.wrong(node, tag, &format!("'{text}' is no frequency")))?;
        Ok(Some(value * scale))
    }

    fn order(&self, node: Node<'a, 'a>, tag: &'static str) -> Order {
        match self.text(node, tag) {
            Some("Right") => Order::LeastFirst,
            _ => Order::MostFirst,
        }
    }

    fn lane(&self, lane: Node<'a, 'a>) -> Result<Lane, CaptureError> {
        let id = lane.attribute("id").unwrap_or_default();
        let block = self.only(lane, "block")?;
        let chunk = self.only(block, "chunk")?;
        let header_bytes = self.integer(block, "sizeheader", Some(0))?;
        let footer = self.integer(block, "sizefooter", Some(0))?;
        if self.integer(block, "cycles", Some(0))? != 0 && header_bytes + footer > 0 {
            return Err(self.wrong(
                block,
                "cycles",
                "blocks with headers or footers are not supported",
            ));
        }
        let system = self.resolve(self.only(lane, "system")?)?;
        let freqbase_hz = self.frequency(system, "freqbase")?.filter(|f| *f > 0.0);
        let freqbase_hz = freqbase_hz
            .ok_or_else(|| self.wrong(system, "freqbase", "a positive frequency is needed"))?;
        let word = self.integer(chunk, "sizeword", None)?;
        let words = self.integer(chunk, "countwords", Some(1))?;
        if !matches!(word, 1 | 2 | 4 | 8) || !(1..=16 / word).contains(&words) {
            let reason = format!(
                "{words} words of {word} bytes: words of 1, 2, 4 or 8 bytes, 16 bytes in all, are supported"
            );
            return Err(self.wrong(chunk, "sizeword", &reason));
        }
        let big_endian = self.text(chunk, "endian") == Some("Big");
        let order = self.order(chunk, "wordshift");
        let mut streams = Vec::new();
        for lump in self.children(chunk, "lump") {
            for stream in self.children(lump, "stream") {
                streams.push(self.stream(stream)?);
            }
        }
        let padding_first = self.text(chunk, "padding") == Some("Head");
        place_streams(&mut streams, (8 * word * words) as u32, order, padding_first)
            .map_err(|reason| self.wrong(chunk, "lump", &reason))?;
        let is_this = |n: &Node| n.attribute("id") == Some(id);
        let file = self
            .children(self.root, "file")
            .find(|f| self.children(*f, "lane").any(|l| is_this(&l)));
        let session = self.children(self.root, "session").next();
        let times = [
            session.and_then(|s| self.text(s, "toa")),
            file.and_then(|f| self.text(f, "timestamp")),
        ];
        Ok(Lane {
            id: id.to_owned(),
            url: file.and_then(|f| self.text(f, "url")).map(str::to_owned),
            header_bytes,
            freqbase_hz,
            byte_order: byte_order(word as usize, words as usize, big_endian, order),
            streams,
            times: times.into_iter().flatten().map(str::to_owned).collect(),
        })
    }

    fn stream(&self, stream: Node<'a, 'a>) -> Result<Stream, CaptureError> {
        let band = self.resolve(self.only(stream, "band")?)?;
        let center_hz = self.frequency(band, "centerfreq")?;
        let center_hz = center_hz.ok_or_else(|| self.wrong(band, "centerfreq", "is missing"))?;
        let small = |tag, default, max| {
            let value = self.integer(stream, tag, default)?;
            let is_small = (1..=max).contains(&value);
            let reason = format!("{value} is not supported: 1 to {max}");
            if is_small { Ok(value as u32) } else { Err(self.wrong(stream, tag, &reason)) }
        };
        let mut placed = Stream {
            id: stream.attribute("id").unwrap_or_default().to_owned(),
            ratefactor: small("ratefactor", Some(1), 128)? as usize,
            bits: small("quantization", None, 16)?,
            packed_bits: small("packedbits", None, 128)?,
            center_hz,
            translated_hz: self.frequency(band, "translatedfreq")?.unwrap_or(0.0),
            bandwidth_hz: self.frequency(band, "bandwidth")?.unwrap_or(20e6),
            ..Stream::default()
        };
        placed.order = self.order(stream, "shift");
        placed.left_aligned = self.text(stream, "alignment") != Some("Right");
        let format = self.text(stream, "format").unwrap_or("IF");
        placed.set_format(format).map_err(|reason| self.wrong(stream, "format", &reason))?;
        let encoding = self.text(stream, "encoding").unwrap_or("SIGN");
        placed.encoding =
            encoding.parse().map_err(|reason: String| self.wrong(stream, "encoding", &reason))?;
        Ok(placed)
    }

    fn wrong(&self, node: Node<'a, 'a>, tag: &str, reason: &str) -> CaptureError {
        let row = node.document().text_pos_at(node.range().start).row;
        let id = node.attribute("id").map(|id| format!(" '{id}'")).unwrap_or_default();
        let field = format!("{}{id} (line {row}), {tag}", node.tag_name().name());
        wrong(self.path, &field, reason)
    }
}

/// Elements by local name, whatever their namespace.
trait LocalName {
    fn has_tag_name_any(&self, tag: &str) -> bool;
}

impl LocalName for Node<'_, '_> {
    fn has_tag_name_any(&self, tag: &str) -> bool {
        self.is_element() && self.tag_name().name() == tag
    }
}
