//! One time that the camera is plugged in: its socket, and the thread that answers the guest.

use super::controls::Answer;
use super::{Camera, descriptors};
use crate::usbredir::{self, Control, Packet, kind, status};
use std::io::{BufReader, Result};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

const GET_DESCRIPTOR: u8 = 6;
/// Type bits of a request that a class defines.
const CLASS_REQUEST: u8 = 0x20;
const TYPE_BITS: u8 = 0x60;

/// The camera's side of the socket. The camera is pulled out when it is dropped.
pub struct Connection {
    stream: UnixStream,
    /// Tells this time from those before.
    time: u64,
}

impl Drop for Connection {
    fn drop(&mut self) {
        // It may be closed already.
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}

impl Connection {
    /// Writes a packet. An error is an end of the connection, which the reading thread sees.
    fn send(&mut self, kind: u32, id: u64, parts: [&[u8]; 2]) {
        let _ = usbredir::write(&mut self.stream, kind, id, parts);
    }

    /// Answers a transfer of the bulk endpoint.
    pub fn bulk(&mut self, id: u64, bytes: &[u8]) {
        let head = usbredir::bulk_answer(descriptors::ENDPOINT, status::DONE, bytes.len());
        self.send(kind::BULK, id, [&head, bytes]);
    }
}

/// The camera, whoever asks; a thread that panicked has failed its step already.
pub fn locked(camera: &Mutex<Camera>) -> MutexGuard<'_, Camera> {
    camera.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Camera {
    /// Plugs the camera in at QEMU's socket.
    pub fn plug(camera: &Arc<Mutex<Camera>>, socket: &Path) -> Result<()> {
        let mut stream = UnixStream::connect(socket)?;
        usbredir::greet(&mut stream)?;
        let time = {
            let mut camera = locked(camera);
            camera.unplug();
            camera.plugged += 1;
            let time = camera.plugged;
            let mut connection = Connection { stream: stream.try_clone()?, time };
            connection.send(kind::ENDPOINT_INFO, 0, [&descriptors::endpoint_info(), &[]]);
            connection.send(kind::INTERFACE_INFO, 0, [&descriptors::interface_info(), &[]]);
            connection.send(kind::DEVICE_CONNECT, 0, [&descriptors::connect(), &[]]);
            camera.connection = Some(connection);
            time
        };
        let camera = Arc::clone(camera);
        thread::spawn(move || {
            let mut reader = BufReader::new(stream);
            while let Ok(packet) = usbredir::read(&mut reader) {
                locked(&camera).answer(&packet);
            }
            let mut camera = locked(&camera);
            if camera.connection.as_ref().is_some_and(|now| now.time == time) {
                camera.unplug();
            }
        });
        Ok(())
    }

    fn send(&mut self, kind: u32, id: u64, parts: [&[u8]; 2]) {
        if let Some(connection) = &mut self.connection {
            connection.send(kind, id, parts);
        }
    }

    fn answer(&mut self, packet: &Packet) {
        let byte = |at: usize| packet.body.get(at).copied().unwrap_or(0);
        match packet.kind {
            kind::SET_CONFIGURATION => {
                self.send(kind::CONFIGURATION_STATUS, packet.id, [&[status::DONE, byte(0)], &[]]);
            }
            kind::GET_CONFIGURATION => {
                self.send(kind::CONFIGURATION_STATUS, packet.id, [&[status::DONE, 1], &[]]);
            }
            kind::SET_ALTERNATE => {
                // A driver that takes the camera begins so; a stream whose transfers had all been answered when its driver was
                // taken away has ended without any other word.
                self.stop();
                self.send(kind::ALTERNATE_STATUS, packet.id, [&[status::DONE, byte(0), byte(1)], &[]]);
            }
            kind::GET_ALTERNATE => {
                self.send(kind::ALTERNATE_STATUS, packet.id, [&[status::DONE, byte(0), 0], &[]]);
            }
            kind::CONTROL => self.control(packet),
            kind::BULK => {
                if let Some(length) = usbredir::bulk_length(&packet.body) {
                    self.waiting.push_back((packet.id, length));
                    self.pump();
                }
            }
            kind::CANCEL => self.cancel(packet.id),
            _ => {}
        }
    }

    /// A transfer is taken back. Nothing else says that the stream has ended.
    fn cancel(&mut self, id: u64) {
        let before = self.waiting.len();
        self.waiting.retain(|(waiting, _)| *waiting != id);
        if self.waiting.len() < before {
            let head = usbredir::bulk_answer(descriptors::ENDPOINT, status::CANCELLED, 0);
            self.send(kind::BULK, id, [&head, &[]]);
            if self.waiting.is_empty() {
                self.stop();
            }
        }
    }

    fn control(&mut self, packet: &Packet) {
        let Some((control, bytes)) = Control::of(&packet.body) else { return };
        let answer = if control.request_type & TYPE_BITS == CLASS_REQUEST {
            self.controls.answer(control.request, control.value, control.index, bytes)
        } else {
            standard(control)
        };
        let mut status = status::DONE;
        let mut sent = Vec::new();
        match answer {
            Answer::Bytes(bytes) => sent = bytes,
            Answer::Written(name, value) => self.writes.push((self.made.len() as u64, name, value)),
            Answer::Started => {
                self.stop_frame();
                // Frames that the stream before did not take are lost with it.
                self.pacing.forget_untaken();
                self.is_streaming = true;
            }
            Answer::Done => {}
            Answer::Stall => status = status::STALL,
        }
        sent.truncate(usize::from(control.length));
        let length = if control.is_read() { sent.len() } else { bytes.len() };
        let head = control.answer(status, length as u16);
        self.send(kind::CONTROL, packet.id, [&head, &sent]);
    }

    /// The next stream begins with a whole frame.
    fn stop_frame(&mut self) {
        self.in_hand = None;
        self.waiting.clear();
    }
}

/// Requests of USB itself: descriptors are sent, everything else is granted.
fn standard(control: Control) -> Answer {
    match (control.request, control.is_read()) {
        (GET_DESCRIPTOR, true) => descriptors::by_value(control.value).map_or(Answer::Stall, Answer::Bytes),
        (_, true) => Answer::Bytes(vec![0, 0]),
        _ => Answer::Done,
    }
}
