// The messages that a bridge sends, field by field in the order of tests/vectors, so that the bytes are the same.
//
// Packer is msgpack::packer of msgpack-cxx, or anything with its functions. tests/examples compiles this file
// with a stand-in for it and compares what comes out with the golden vectors.
#pragma once

#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

namespace caesura {

inline std::string encoding_of(const std::string& type) { return "application/msgpack;caesura." + type + ".v1"; }

inline std::string station_key(const std::string& station, const std::string& part) {
    return "caesura/v1/station/" + station + "/" + part;
}

/// What is said of a session once; columns begin with "t".
struct Opening {
    std::string session;
    std::uint64_t epoch = 0;
    std::vector<std::string> columns;
    std::string wrench_source;              // flange_sensor, flange_sensor_with_hand, joint_torque_estimate, none;
                                            // empty: not stated, contact and load stay off
    std::string hand_on_robot = "unknown";  // yes, no: does a person guide this robot by hand?
    std::string force_frame = "base";       // flange
    std::string length_unit = "m";          // cm, mm
    std::string bridge;                     // names this one among all, [a-z0-9][a-z0-9_-]*; empty: not named
    std::string robot;                      // a name as of `caesura robots`; empty: not stated
    std::vector<double> up;                 // x y z away from gravity in the base frame; empty: z is assumed
    std::string task;                       // what is shown; empty: not named
    std::string operator_name;              // who shows it
};

template <class Packer>
void pack_text(Packer& pk, const std::string& text) {
    if (text.empty()) {
        pk.pack_nil();
    } else {
        pk.pack(text);
    }
}

template <class Packer>
void pack_names(Packer& pk, const std::vector<std::string>& names) {
    pk.pack_array(static_cast<std::uint32_t>(names.size()));
    for (const auto& name : names) pk.pack(name);
}

template <class Packer>
void pack_direction(Packer& pk, const std::vector<double>& direction) {
    if (direction.empty()) {
        pk.pack_nil();
        return;
    }
    pk.pack_array(static_cast<std::uint32_t>(direction.size()));
    for (const double value : direction) pk.pack(value);
}

template <class Packer>
void pack_description(Packer& pk, const Opening& opening) {
    pk.pack_map(6);
    pk.pack(std::string("task"));
    pack_text(pk, opening.task);
    pk.pack(std::string("operator"));
    pack_text(pk, opening.operator_name);
    pk.pack(std::string("note"));
    pk.pack_nil();
    pk.pack(std::string("tags"));
    pk.pack_array(0);
    pk.pack(std::string("success"));
    pk.pack_nil();  // stated at the end
    pk.pack(std::string("deleted"));
    pk.pack_false();
}

/// Encoding Control.
template <class Packer>
void pack_open(Packer& pk, const Opening& opening) {
    pk.pack_map(1);
    pk.pack(std::string("command"));
    pk.pack_map(18);
    pk.pack(std::string("type"));
    pk.pack(std::string("open"));
    pk.pack(std::string("session"));
    pk.pack(opening.session);
    pk.pack(std::string("epoch"));
    pk.pack(opening.epoch);
    pk.pack(std::string("columns"));
    pack_names(pk, opening.columns);
    pk.pack(std::string("wrench_source"));
    pack_text(pk, opening.wrench_source);
    pk.pack(std::string("hand_on_robot"));
    pk.pack(opening.hand_on_robot);
    pk.pack(std::string("force_frame"));
    pk.pack(opening.force_frame);
    pk.pack(std::string("length_unit"));
    pk.pack(opening.length_unit);
    pk.pack(std::string("preset"));
    pk.pack_nil();  // the service's own choice
    pk.pack(std::string("bridge"));
    pack_text(pk, opening.bridge);
    pk.pack(std::string("force_limit_n"));
    pk.pack_nil();  // forces as they were taught
    pk.pack(std::string("path_tolerance_m"));
    pk.pack_nil();
    pk.pack(std::string("path_tolerance_rad"));
    pk.pack_nil();
    pk.pack(std::string("robot"));
    pack_text(pk, opening.robot);
    pk.pack(std::string("up"));
    pack_direction(pk, opening.up);
    pk.pack(std::string("declared_units"));
    pk.pack_array(0);  // implausible values are refused
    pk.pack(std::string("assumed"));
    pk.pack_array(0);  // a robot states the frame of its force, and sends quaternions as x y z w
    pk.pack(std::string("description"));
    pack_description(pk, opening);
}

/// Encoding Control. last_seq: the number of the last batch, -1 where there was none; success: did it succeed?
template <class Packer>
void pack_close(Packer& pk, const Opening& opening, std::int64_t last_seq, std::optional<bool> success = {}) {
    pk.pack_map(1);
    pk.pack(std::string("command"));
    pk.pack_map(5);
    pk.pack(std::string("type"));
    pk.pack(std::string("close"));
    pk.pack(std::string("session"));
    pk.pack(opening.session);
    pk.pack(std::string("last_seq"));
    pk.pack(last_seq);
    pk.pack(std::string("bridge"));
    pack_text(pk, opening.bridge);
    pk.pack(std::string("success"));
    if (!success) {
        pk.pack_nil();
    } else if (*success) {
        pk.pack_true();
    } else {
        pk.pack_false();
    }
}

/// Encoding SampleBatch. rows: a matrix (n, columns) row by row, float or double, little-endian; in its first
/// column the time since t0 [s]. Every value is finite, n is at most 1000.
template <class Packer, class Real>
void pack_batch(Packer& pk, const Opening& opening, std::uint64_t seq, double t0, const std::vector<Real>& rows) {
    const auto bytes = static_cast<std::uint32_t>(rows.size() * sizeof(Real));
    pk.pack_map(8);
    pk.pack(std::string("session"));
    pk.pack(opening.session);
    pk.pack(std::string("epoch"));
    pk.pack(opening.epoch);
    pk.pack(std::string("seq"));
    pk.pack(seq);
    pk.pack(std::string("n"));
    pk.pack(static_cast<std::uint64_t>(rows.size() / opening.columns.size()));
    pk.pack(std::string("columns"));
    pack_names(pk, opening.columns);
    pk.pack(std::string("t0"));
    pk.pack(t0);
    pk.pack(std::string("samples"));
    pk.pack_bin(bytes);
    pk.pack_bin_body(reinterpret_cast<const char*>(rows.data()), bytes);
    pk.pack(std::string("bridge"));
    pack_text(pk, opening.bridge);
}

/// Encoding Heartbeat: twice a second while nothing else is sent. seq: the last batch that was put.
template <class Packer>
void pack_heartbeat(Packer& pk, const Opening& opening, std::int64_t seq) {
    pk.pack_map(4);
    pk.pack(std::string("session"));
    pk.pack(opening.session);
    pk.pack(std::string("epoch"));
    pk.pack(opening.epoch);
    pk.pack(std::string("seq"));
    pk.pack(seq);
    pk.pack(std::string("bridge"));
    pack_text(pk, opening.bridge);
}

/// Encoding Error, the answer to a replay that asks for what the ring has lost.
template <class Packer>
void pack_evicted(Packer& pk, std::uint64_t asked, std::uint64_t oldest) {
    pk.pack_map(4);
    pk.pack(std::string("code"));
    pk.pack(std::string("evicted"));
    pk.pack(std::string("message"));
    pk.pack(std::string("the ring no longer has these samples"));
    pk.pack(std::string("value"));
    pk.pack(asked);
    pk.pack(std::string("limit"));
    pk.pack(oldest);
}

}  // namespace caesura
