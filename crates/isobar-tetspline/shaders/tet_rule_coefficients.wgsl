// Cubes by all their coefficients: conservative, as tight as the hull property allows.
fn is_active(q: vec3<i32>) -> bool {
    let hull = data_hull(q);
    let slack = slack_of(hull);
    if !meets(hull.x, hull.y, 1.0, slack) {
        return false;
    }
    return kinds_of(q, 192.0 * slack) != 0u;
}
