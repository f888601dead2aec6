//! The sensor behind a video node: a sub-device of a media controller, whose exposure is counted in lines.
//!
//! A receiver's node has no controls of its own; its sensor has them. Which one it is, the controller's links say. The links
//! and formats between them are somebody else's to set up (`media-ctl`, or libcamera, which runs such cameras by itself).

pub mod sys;

/// Something in a media controller: a sensor, a receiver, a video node.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MediaEntity {
    /// The controller's number.
    pub id: u32,
    /// For people.
    pub name: String,
    /// Whether it is a camera's sensor.
    pub is_sensor: bool,
    /// The kernel's number of its node, where it has one.
    pub node: Option<u64>,
}

/// Pictures go from one entity to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MediaLink {
    /// From here.
    pub from: u32,
    /// To here.
    pub to: u32,
    /// Whether they do now.
    pub is_enabled: bool,
}

/// All that a media controller has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MediaTopology {
    /// In the controller's order.
    pub entities: Vec<MediaEntity>,
    /// Each once.
    pub links: Vec<MediaLink>,
}

impl MediaTopology {
    /// The sensor whose pictures come to a node, by enabled links; where there is none, the first that could. `None` where the node
    /// is not of this controller.
    pub fn sensor_of(&self, node: u64) -> Option<&MediaEntity> {
        let end = self.entities.iter().find(|entity| entity.node == Some(node))?;
        self.upstream(end.id, true).or_else(|| self.upstream(end.id, false))
    }

    /// The nearest sensor against the way of the pictures. Links may go in circles.
    fn upstream(&self, end: u32, needs_enabled: bool) -> Option<&MediaEntity> {
        let mut reached = vec![end];
        let mut next = 0;
        while let Some(&to) = reached.get(next) {
            next += 1;
            let entity = self.entities.iter().find(|entity| entity.id == to);
            if let Some(sensor) = entity.filter(|entity| entity.is_sensor) {
                return Some(sensor);
            }
            for link in self.links.iter().filter(|link| link.to == to && (link.is_enabled || !needs_enabled))
            {
                if !reached.contains(&link.from) {
                    reached.push(link.from);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entity(id: u32, is_sensor: bool, node: Option<u64>) -> MediaEntity {
        MediaEntity { id, name: format!("entity {id}"), is_sensor, node }
    }

    /// Two sensors before a switch, a receiver, a scaler with a link back, two video nodes.
    fn board() -> MediaTopology {
        let link = |from, to, is_enabled| MediaLink { from, to, is_enabled };
        MediaTopology {
            entities: vec![
                entity(1, true, Some(0x5101)),
                entity(2, true, Some(0x5102)),
                entity(3, false, Some(0x5103)),
                entity(4, false, None),
                entity(5, false, Some(0x5100)),
                entity(6, false, Some(0x5106)),
            ],
            links: vec![
                link(1, 3, false),
                link(2, 3, true),
                link(3, 4, true),
                link(4, 3, true),
                link(4, 5, true),
                link(1, 6, false),
            ],
        }
    }

    #[test]
    fn the_sensor_is_the_one_whose_link_is_on() {
        let board = board();
        assert_eq!(board.sensor_of(0x5100).unwrap().id, 2);
        // Nothing is on: the one that could be.
        assert_eq!(board.sensor_of(0x5106).unwrap().id, 1);
        assert_eq!(board.sensor_of(0x9999), None);
        assert_eq!(MediaTopology::default().sensor_of(0x5100), None);
    }

    #[test]
    fn a_board_without_sensors_ends() {
        let mut board = board();
        board.entities.iter_mut().for_each(|entity| entity.is_sensor = false);
        assert_eq!(board.sensor_of(0x5100), None);
    }
}
