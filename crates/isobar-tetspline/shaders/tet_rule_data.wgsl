// Cubes by the least and greatest of their 27 data: conservative.
fn is_active(q: vec3<i32>) -> bool {
    let hull = data_hull(q);
    return meets(hull.x, hull.y, 1.0, slack_of(hull));
}
