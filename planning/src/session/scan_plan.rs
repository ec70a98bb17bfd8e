//! Several next views at once, for cells where planning after each scan is not possible: chosen by what they would see together of
//! the surface that is expected now, ordered by travel.

mod looks;

use super::Session;
use crate::answer::{Answer, Candidate};
use crate::config::PlannerName;
use crate::turntable::turn_between_deg;
use looks::Looks;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A turn of the table by a radian is worth this much travel of the camera, metres.
const TURN_M: f64 = 0.1;
/// Views that add less than this share of the whole are left out.
const LEAST: f64 = 1e-3;

/// Views to take one after the other, without planning between them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScanPlan {
    /// In the order of travel.
    pub views: Vec<PlannedView>,
    /// From where the camera is over all views, straight, in the cell, metres.
    pub travel_m: f64,
    /// What the table turns in all, degrees.
    pub turn_deg: f64,
    /// Share of the whole surface that they are expected to add together. With `leaves` it is what is missing now: `missing.share` and
    /// `missing.out_of_reach_share` of the answer.
    pub adds: f64,
    /// Share of the whole that is expected to be missing afterwards: what no allowed view is expected to measure
    /// (`missing.out_of_reach_share`), and what these views do not find of the rest.
    pub leaves: f64,
}

/// A view of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedView {
    /// Share of the whole surface that it adds to those chosen before it, on the scale of what is missing. `expected_gain` is of this view alone,
    /// and does not count what bulges behind the membrane.
    pub adds: f64,
    /// In which order it was chosen, from 0: the views up to any number are the best plan of that length.
    pub chosen: usize,
    /// Straight from the view before, metres.
    pub travel_m: f64,
    /// The view.
    #[serde(flatten)]
    pub view: Candidate,
}

impl Session {
    /// At most `most` of the views that `answer` allows, the greedy choice: each sees most of the expected surface that those before it
    /// do not see; `max_travel_m` and `visited_radius_m` hold between them, too. `None` where the planner that answered does not make out what is missing, or had no time to. It is of the state at that answer. Travel begins at
    /// `current_m`, in the cell, as [`Request::current_position_m`](super::Request::current_position_m).
    pub fn scan_plan(&self, answer: &Answer, most: usize, current_m: Option<[f64; 3]>) -> Option<ScanPlan> {
        let made_out = answer.complete && answer.planner == PlannerName::Volumetric.as_str();
        let (missing, told) = answer.missing.as_ref().zip(answer.surface).filter(|_| made_out)?;
        // Parts are shares of what the membrane makes out; the whole that is missing is told from that (stop.rs).
        let surface = self.planners.surface(PlannerName::Volumetric)?;
        let allowed: Vec<&Candidate> = answer.candidates.iter().filter(|c| c.objections.is_empty()).collect();
        let poses: Vec<Isometry3<f64>> = allowed.iter().map(|c| c.pose()).collect();
        let (seen, areas) = self.planners.seen_of_expected(&self.state, &poses);
        let limits = &self.config.constraints;
        let mut looks = Looks::new(&seen, &areas, &surface, &told, missing);
        let from = (self.camera_now(current_m), self.table_deg());
        let all: Vec<Stop> = allowed.iter().map(|c| stop(c, from.1)).collect();
        let mut chosen: Vec<(usize, f64)> = Vec::new();
        let mut open = vec![true; allowed.len()];
        while chosen.len() < most {
            let gain = |(view, open): (&Vec<_>, &bool)| if *open { looks.unseen(view) } else { 0.0 };
            let gains: Vec<f64> = seen.iter().zip(&open).map(gain).collect();
            // The first of equals: the one ranked higher.
            let Some(best) = (0..gains.len()).reduce(|a, b| if gains[b] > gains[a] { b } else { a }) else { break };
            if gains[best] < self.config.stop_below.max(LEAST) {
                break;
            }
            open[best] = false;
            let others = || chosen.iter().map(|&(i, _)| i);
            let away = others().map(|i| (poses[i].translation.vector - poses[best].translation.vector).norm());
            let is_repetition = away.fold(f64::INFINITY, f64::min) < limits.visited_radius_m.unwrap_or(0.0);
            let stops: Vec<Stop> = others().chain([best]).map(|i| all[i]).collect();
            if is_repetition || longest_move(from, &stops) > limits.max_travel_m.unwrap_or(f64::INFINITY) {
                continue;
            }
            let axis = |i: usize| poses[i] * Vector3::z();
            let alike = others().map(|i| axis(i).dot(&axis(best))).fold(-1.0, f64::max);
            chosen.push((best, looks.take(&seen[best], (1.0 - alike).min(1.0))));
        }
        let stops: Vec<Stop> = chosen.iter().map(|&(i, _)| all[i]).collect();
        let order = by_travel(from, &stops);
        let mut plan = ScanPlan::default();
        let mut at = (from.0.unwrap_or(order.first().map_or(Point3::origin(), |&i| stops[i].0)), from.1);
        for i in order {
            let travel_m = (stops[i].0 - at.0).norm();
            plan.travel_m += travel_m;
            plan.turn_deg += turn_between_deg(stops[i].1, at.1);
            plan.adds += chosen[i].1;
            at = stops[i];
            let view = allowed[chosen[i].0].clone();
            plan.views.push(PlannedView { adds: chosen[i].1, chosen: i, travel_m, view });
        }
        plan.leaves = missing.out_of_reach_share + (missing.share - plan.adds).max(0.0);
        Some(plan)
    }

    /// Where the camera is, in the cell: as the request says, else as the settings do, else where the last scan was taken, even if that was
    /// rejected (but on a turntable, whose angle then only scans that were taken tell).
    pub(super) fn camera_now(&self, requested_m: Option<[f64; 3]>) -> Option<Point3<f64>> {
        let told = requested_m.or(self.config.constraints.current_position_m).map(Point3::from);
        let rejected = self.unregistered.last().copied().filter(|_| self.config.turntable.is_none());
        let last = || rejected.or_else(|| self.latest()?.camera_position()).map(|p| self.cell_from_object() * p);
        told.or_else(last)
    }
}

/// Where the camera stands in the cell, and the table, degrees.
type Stop = (Point3<f64>, f64);

fn stop(candidate: &Candidate, table_deg: f64) -> Stop {
    (candidate.position_in_cell(), candidate.table.as_ref().map_or(table_deg, |table| table.stop_deg))
}

/// The farthest that the camera moves at once on that way, metres.
fn longest_move(from: (Option<Point3<f64>>, f64), stops: &[Stop]) -> f64 {
    let way: Vec<Point3<f64>> =
        from.0.into_iter().chain(by_travel(from, stops).into_iter().map(|i| stops[i].0)).collect();
    way.windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max)
}

/// A short way over all stops: the nearest next, then pairs of legs uncrossed while that helps (2-opt). Where it begins is open without
/// a position.
fn by_travel((from, table_deg): (Option<Point3<f64>>, f64), stops: &[Stop]) -> Vec<usize> {
    let cost = |a: &Stop, b: &Stop| (a.0 - b.0).norm() + TURN_M * turn_between_deg(a.1, b.1).to_radians();
    let start = |to: &Stop| cost(&(from.unwrap_or(to.0), table_deg), to);
    let mut order: Vec<usize> = Vec::new();
    let mut left: Vec<usize> = (0..stops.len()).collect();
    while !left.is_empty() {
        let leg =
            |&i: &usize| order.last().map_or_else(|| start(&stops[i]), |&last: &usize| cost(&stops[last], &stops[i]));
        let next = (0..left.len()).min_by(|&a, &b| leg(&left[a]).total_cmp(&leg(&left[b]))).unwrap_or(0);
        order.push(left.remove(next));
    }
    let length = |order: &[usize]| {
        order.first().map_or(0.0, |&i| start(&stops[i]))
            + order.windows(2).map(|w| cost(&stops[w[0]], &stops[w[1]])).sum::<f64>()
    };
    let mut best = length(&order);
    loop {
        let pairs = (0..order.len()).flat_map(|i| (i + 1..order.len()).map(move |j| (i, j)));
        let turned = pairs.map(|(i, j)| {
            let mut other = order.clone();
            other[i..=j].reverse();
            (length(&other), other)
        });
        match turned.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(shorter, _)| *shorter < best - 1e-9) {
            Some((shorter, other)) => (best, order) = (shorter, other),
            None => return order,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::Request;
    use crate::{Missing, Scan, SessionConfig};
    use geometry::{PointCloud, View};

    #[test]
    fn the_way_is_as_short_as_any() {
        let at = |x: f64, y: f64, deg: f64| (Point3::new(x, y, 0.0), deg);
        let stops = [
            at(0.0, 3.0, 0.0),
            at(1.0, 0.0, 0.0),
            at(3.0, 3.0, 0.0),
            at(2.0, 0.0, 0.0),
            at(3.0, 1.0, 0.0),
            at(0.0, 2.0, 0.0),
        ];
        let way = |order: &[usize]| {
            let mut at = Point3::origin();
            order.iter().map(|&i| (stops[i].0 - std::mem::replace(&mut at, stops[i].0)).norm()).sum::<f64>()
        };
        let found = way(&by_travel((Some(Point3::origin()), 0.0), &stops));
        let mut shortest = f64::INFINITY;
        let mut order = [0, 1, 2, 3, 4, 5];
        // All orders (Heap).
        fn all(k: usize, order: &mut [usize; 6], visit: &mut impl FnMut(&[usize])) {
            if k == 1 {
                return visit(order);
            }
            for i in 0..k {
                all(k - 1, order, visit);
                order.swap(if k.is_multiple_of(2) { i } else { 0 }, k - 1);
            }
        }
        all(6, &mut order, &mut |order| shortest = shortest.min(way(order)));
        assert!(found <= shortest + 1e-9, "{found} {shortest}");
        let turned = [at(0.0, 0.0, 180.0), at(0.0, 0.0, 350.0), at(0.0, 0.0, 90.0)];
        assert_eq!(
            by_travel((Some(Point3::origin()), 0.0), &turned),
            [1, 2, 0],
            "a camera that stands still: by turning"
        );
    }

    /// A flat sheet that was seen from above.
    fn sheet() -> Session {
        let points = (0..900).map(|i| Point3::new(0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30), 0.0)).collect();
        let cloud = PointCloud { points, normals: Vec::new() };
        let config = SessionConfig { working_distance_m: 0.6, ..Default::default() };
        let mut session = Session::new(config, None).expect("settings");
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 0.6)) }).expect("a scan");
        session
    }

    /// What a plan adds and leaves is what is missing, within and out of reach.
    fn assert_adds_up(plan: &ScanPlan, missing: &Missing) {
        let now = missing.share + missing.out_of_reach_share;
        assert!((plan.adds + plan.leaves - now).abs() < 1e-9, "{} and {} are not {now}", plan.adds, plan.leaves);
        assert!(plan.leaves >= missing.out_of_reach_share, "{} of {missing:?}", plan.leaves);
        assert!((plan.views.iter().map(|v| v.adds).sum::<f64>() - plan.adds).abs() < 1e-9);
    }

    #[test]
    fn views_add_up_and_leave_less() {
        let mut session = sheet();
        let answer = session.next_view().expect("an answer");
        let plans: Vec<ScanPlan> =
            [1, 3, 8].iter().map(|&most| session.scan_plan(&answer, most, None).expect("a plan")).collect();
        let missing = answer.surface.map(|s| s.expected_m2 / (s.known_m2 + s.expected_m2)).expect("a surface");
        for (plan, most) in plans.iter().zip([1, 3, 8]) {
            assert!(!plan.views.is_empty() && plan.views.len() <= most);
            assert!(plan.adds > 0.0 && plan.adds < missing && plan.leaves < missing, "{plan:?}");
            assert_adds_up(plan, answer.missing.as_ref().expect("made out"));
            assert!((plan.views.iter().map(|v| v.travel_m).sum::<f64>() - plan.travel_m).abs() < 1e-9);
            assert!(plan.views.iter().all(|v| v.view.objections.is_empty()));
        }
        assert!(plans[2].adds > plans[0].adds && plans[2].leaves < plans[0].leaves, "more views see more");
        let far = session.scan_plan(&answer, 3, Some([100.0, 0.0, 0.0])).expect("a plan");
        assert!((80.0..120.0).contains(&(far.travel_m - plans[1].travel_m)), "it sets out from where the camera is");
        let first = plans[1].views.iter().find(|view| view.chosen == 0).expect("a first choice");
        assert_eq!(first.view, plans[0].views[0].view, "the first choice stays");
        assert_eq!(first.adds, plans[0].views[0].adds, "and adds the same");
    }

    #[test]
    fn limits_of_travel_and_repetition_hold_between_the_views_of_a_plan() {
        let mut session = sheet();
        let current_m = Some([0.06, 0.06, 0.6]);
        let plan = |session: &mut Session| {
            let request = Request { current_position_m: current_m, ..Default::default() };
            let answer = session.next_view_for(&request).expect("an answer");
            session.scan_plan(&answer, 8, current_m).expect("a plan")
        };
        let moves = |plan: &ScanPlan| plan.views.iter().map(|v| v.travel_m).fold(0.0, f64::max);
        let apart = |plan: &ScanPlan| {
            let at = |i: usize| Point3::from(plan.views[i].view.position_m);
            let pairs = (0..plan.views.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
            pairs.map(|(i, j)| (at(i) - at(j)).norm()).fold(f64::INFINITY, f64::min)
        };
        let free = plan(&mut session);
        assert!(moves(&free) > 0.51 && apart(&free) < 0.3, "{} {}", moves(&free), apart(&free));
        let mut config = session.config().clone();
        config.constraints.max_travel_m = Some(0.51);
        config.constraints.visited_radius_m = Some(0.3);
        session.configure(config).expect("settings");
        let limited = plan(&mut session);
        assert!(limited.views.len() > 1, "{limited:?}");
        assert!(moves(&limited) <= 0.51 && apart(&limited) >= 0.3, "{} {}", moves(&limited), apart(&limited));
    }

    #[test]
    fn where_all_allowed_views_are_taken_what_is_out_of_reach_is_left() {
        // Flat from below: the underside is seen at a grazing angle, the far edges not at all.
        let target = Point3::new(0.06, 0.06, 0.0);
        let views = [[0.57, 0.0, -0.186], [-0.57, 0.0, -0.186]].map(|from| {
            let view = View { target, position: target + Vector3::from(from) };
            view.world_from_camera()
        });
        for count in [1, 2] {
            let mut session = sheet();
            session.set_given_views(views[..count].to_vec());
            let answer = session.next_view().expect("an answer");
            let missing = answer.missing.as_ref().expect("made out");
            assert!(missing.share > 0.2 && missing.out_of_reach_share > 0.1, "{missing:?}");
            let plan = session.scan_plan(&answer, 8, None).expect("a plan");
            assert_eq!(plan.views.len(), count);
            assert_adds_up(&plan, missing);
            // Out of reach was told from samples.
            assert!(plan.leaves < missing.out_of_reach_share + 0.1 * missing.share, "{} of {missing:?}", plan.leaves);
        }
    }
}
