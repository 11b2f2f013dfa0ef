//! Type 3 of the paper counted against COVERED, which is proved.

use crate::tests::{annulus, element, hexes, request};
use crate::{NURBS_CPU, NURBS_CPU_PAPER};
use isobar_core::{Claim, DVec3, Data, Frame, Method, Sampling, Stop, Surface, View};
use std::sync::Arc;

fn draw(method: &dyn Method, data: &Arc<Data>, c: f64, view: &View, knobs: &[(&str, &str)], sampling: Sampling) -> Frame {
    let mut q = request(1);
    q.sampling = sampling;
    knobs.iter().for_each(|(k, v)| q.knobs.set(k, v));
    let mut r = method.open(&q).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(&[Surface::isovalue(c, 0)]).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    f
}

/// Pixels that are COVERED, those of them that Q shows, and those Q shows elsewhere (with no hit on the centre's ray).
fn count(data: &Arc<Data>, c: f64, view: &View, knobs: &[(&str, &str)]) -> [usize; 3] {
    let truth = draw(&NURBS_CPU, data, c, view, &[], Sampling::PixelFrustum);
    let centres = draw(&NURBS_CPU_PAPER, data, c, view, knobs, Sampling::PixelCentre);
    let frusta = draw(&NURBS_CPU_PAPER, data, c, view, knobs, Sampling::PixelFrustum);
    let mut out = [0; 3];
    for i in 0..truth.hits.len() {
        let covered = truth.claim[i].contains(Claim::COVERED);
        let shown = centres.hits[i] == 0 && frusta.hits[i] > 0;
        assert!(centres.hits[i] == 0 || frusta.t[i] == centres.t[i]);
        out[0] += usize::from(covered);
        out[1] += usize::from(covered && (shown || centres.hits[i] > 0));
        out[2] += usize::from(shown && truth.hits[i] == 0 && !covered);
    }
    out
}

/// A closed surface inside the element, with nothing but silhouettes for edges: x^2 + y^2 + z^2 in a bent element.
fn ball() -> Arc<Data> {
    let at = |u: [f64; 3]| u.map(|u| 2.0 * u - 1.0);
    let e = element(
        [2; 3],
        |u| {
            let [x, y, z] = at(u);
            [x + 0.2 * y * y, y + 0.1 * x * z, z]
        },
        [2; 3],
        &element([2; 3], |u| [at(u).iter().map(|x| x * x).sum(), 0.0, 0.0], [0; 3], &[0.0])
            .points
            .iter()
            .map(|p| p[0])
            .collect::<Vec<_>>(),
    );
    hexes(vec![e])
}

#[test]
fn type_3_against_covered() {
    let view = View::perspective(DVec3::new(4.0, 3.0, 3.5), DVec3::ZERO, DVec3::Z, 40.0, 32, 32);
    let square: &[(&str, &str)] = &[];
    let disc: &[(&str, &str)] = &[("silhouettes", "disc")];
    let knots: &[(&str, &str)] = &[("subdivision", "knots")];
    let all = [square, disc, knots].map(|k| count(&ball(), 0.5, &view, k));
    // COVERED, of these shown by Q, shown where nothing is: the square misses pixels whose corners the outline cuts, the disc does not.
    assert_eq!(all, [[24, 19, 0], [24, 24, 0], [24, 19, 0]]);
    // A surface that ends at the element's faces: the quarter annulus.
    let view = View::perspective(DVec3::new(4.0, 3.0, 3.5), DVec3::new(0.8, 0.8, 0.5), DVec3::Z, 40.0, 32, 32);
    let edges = [square, disc].map(|k| count(&hexes(vec![annulus()]), 0.5, &view, k));
    // Edges on the element's faces are no silhouettes: the 3 are hits on the centre's ray within the printed quarter pixel.
    assert_eq!(edges, [[29, 3, 0], [29, 3, 0]]);
}
