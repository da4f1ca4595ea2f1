-- Relay and step experiment of gcs-autotune, flown by the autopilot itself. The table S is put before these lines.
-- The file deletes itself as soon as it is loaded, so no later start of the autopilot runs it.
-- Outputs are held for S.hold ms at a time: if this script stops, the autopilot's own neutral outputs return.
local LEAST, LONGEST, BLOCK, REPEAT = 3000, 30000, 1500, 3000
local MOMENTUM, GONE, LEAST_REVERSALS = 5000, 1000, 3
local QUICK, SLOW, PER_HALF = 40, 200, 25
local FAR_OUT, TURN, HOMEWARD, TURNING = 0.4, 0.5, 0.35, 60000
local HUGE = math.huge
remove(S.path)
local go = Parameter(S.go)
local loaded, last_text, last_fence = millis():toint(), nil, nil
local stage, word = 'ready', 'ready'
local began, phase_began, index, ph = 0, 0, 0, 0
local m = { psi = 0 }
local home, first, rest, had_rc, has_fence, seen_at
local F = {}
local LAPSE, LAPSE_SHARE = 1000, 0.02
local lapse, ticked = 0, nil
local logged, every = 0, nil -- a slow craft needs fewer rows a second than a quick one

local function say(text)
  gcs:send_text(6, 'aboard ' .. S.id .. ' ' .. text)
  last_text = millis():toint()
end

local function clamp(v, low, high)
  return math.max(low, math.min(high, v))
end

local function drive(forces, hold)
  for _, o in ipairs(S.outputs) do
    local share = 0
    for name, factor in pairs(o.of) do
      share = share + factor * (forces[name] or 0)
    end
    share = clamp(share, -1, 1)
    local pwm = o.trim + share * (share > 0 and o.up or o.down)
    SRV_Channels:set_output_pwm_chan_timeout(o.chan, math.floor(pwm + 0.5), hold)
  end
  F = forces
end

local function whole(v, scale)
  if not v then
    return -32768
  end
  return math.floor(clamp(v / scale, -32767, 32767) + 0.5)
end

local function log()
  local r = S.log.rows
  logger:write(r[1], r[2], r[3], ph, whole(F.X or 0, 1e-4), whole(F.Z or 0, 1e-4),
    whole(F.N or 0, 1e-4), whole(m.psi_wrapped, 1e-4), whole(m.r, 1e-3), m.x or HUGE, m.y or HUGE, m.z or HUGE,
    whole(m.u, 1e-3), whole(m.v, 1e-3), whole(m.w, 1e-3))
end

local function finish(text)
  drive({}, 1)
  if index > 0 then
    log()
  end
  stage, word = 'ended', text
  say(word)
end

local function sense(now)
  local psi = ahrs:get_yaw()
  if m.psi_wrapped then
    local turn = psi - m.psi_wrapped
    m.psi = m.psi + turn - 2 * math.pi * math.floor(turn / (2 * math.pi) + 0.5)
  else
    m.psi = psi
  end
  m.psi_wrapped, m.r = psi, ahrs:get_gyro():z()
  m.phi, m.theta = ahrs:get_roll(), ahrs:get_pitch()
  local p, v = ahrs:get_relative_position_NED_origin(), ahrs:get_velocity_NED()
  if p then
    m.x, m.y, m.z, seen_at = p:x(), p:y(), p:z(), now
  elseif baro then
    m.z = -baro:get_altitude()
  end
  if v then
    local c, s = math.cos(psi), math.sin(psi)
    m.u, m.v, m.w = v:x() * c + v:y() * s, v:y() * c - v:x() * s, v:z()
    m.speed = math.sqrt(v:x() ^ 2 + v:y() ^ 2)
  end
end

local function beyond(zone)
  local c, n = zone.corners, #zone.corners
  if n == 2 then
    return (math.sqrt((m.x - c[1]) ^ 2 + (m.y - c[2]) ^ 2) > zone.radius) == zone.inside
  end
  local odd, x1, y1 = false, c[n - 1], c[n]
  for i = 1, n, 2 do
    local x2, y2 = c[i], c[i + 1]
    if (y1 > m.y) ~= (y2 > m.y) and m.x < x1 + (m.y - y1) / (y2 - y1) * (x2 - x1) then
      odd = not odd
    end
    x1, y1 = x2, y2
  end
  return odd ~= zone.inside
end

local function away()
  return home and math.sqrt((m.x - home.x) ^ 2 + (m.y - home.y) ^ 2) or 0
end

local function order()
  if not arming:is_armed() then
    return 'disarmed'
  elseif vehicle:get_mode() ~= S.mode then
    return 'mode changed'
  elseif had_rc and not rc:has_valid_input() then
    return 'radio failsafe'
  elseif go:get() ~= S.id then
    return 'stopped'
  end
  for channel, pwm in pairs(rest) do
    local is = rc:get_pwm(channel)
    if is and math.abs(is - pwm) > S.stick then
      return 'stick ' .. channel
    end
  end
  if S.silence and (millis() - gcs:last_seen()):toint() > S.silence then
    return 'silence'
  end
end

local function over(name, value)
  return S.limits[name] and value and not (value <= S.limits[name])
end

local function limit(now)
  if over('heading', math.abs(m.psi - first.psi)) then
    return 'heading excursion'
  elseif over('depth_excursion', m.z and first.z and math.abs(m.z - first.z)) then
    return 'depth excursion'
  elseif over('depth_max', m.z) then
    return 'greatest depth'
  elseif S.limits.depth_min and m.z and not (m.z >= S.limits.depth_min) then
    return 'least depth'
  elseif over('speed', m.speed) then
    return 'speed'
  elseif over('distance', away()) then
    return 'distance from start'
  elseif over('turn_rate', math.abs(m.r)) then
    return 'turn rate'
  elseif over('roll', math.abs(m.phi)) then
    return 'roll'
  elseif over('pitch', math.abs(m.theta)) then
    return 'pitch'
  elseif over('time', (now - phase_began) * 1e-3) or over('whole', (now - began) * 1e-3) then
    return 'time'
  elseif home and now - seen_at > GONE then
    return 'position lost'
  elseif has_fence and fence:get_breaches() ~= 0 then
    return 'fence'
  end
  if battery and battery:num_instances() > 0 and battery:healthy(0) then
    local left = battery.capacity_remaining_pct and battery:capacity_remaining_pct(0)
    if S.limits.volts and not (battery:voltage(0) >= S.limits.volts) then
      return 'battery voltage'
    elseif S.limits.charge and left and not (left >= S.limits.charge) then
      return 'battery remaining'
    end
  end
  for _, zone in ipairs(m.x and S.zones or {}) do
    if beyond(zone) then
      return 'outside the area'
    end
  end
end

local function hold(forces)
  for _, h in ipairs(S.holds) do
    local x = m[h.signal]
    if x then
      h.reference = h.reference or x
      local e = h.reference - x
      h.sum = clamp((h.sum or 0) + h.I * e * S.period * 1e-3, -h.most, h.most)
      forces[h.force] = clamp(h.P * e - h.D * (m[h.rate] or 0) + h.sum, -h.most, h.most)
    end
  end
  return forces
end

-- one approach: neutral steering until the speed is steady, and the noise of the signal
local a

local function approach_begin(now)
  a = { t = now, next = now, n = 0, sum = 0, block = now + BLOCK, us = 0, un = 0 }
end

local function approach(now)
  local forces = hold({ X = S.throttle })
  if S.before and not forces[S.force] then
    local e = (a.x or m[S.signal]) - m[S.signal]
    a.x = a.x or m[S.signal]
    forces[S.force] = clamp(S.before.P * e - S.before.D * (m[S.before.rate] or 0), -S.before.most, S.before.most)
  end
  drive(forces, S.hold)
  if now >= a.next then
    local x = m[S.signal]
    if a.x2 then
      a.sum, a.n = a.sum + (x - 2 * a.x1 + a.x2) ^ 2, a.n + 1
    end
    a.x2, a.x1, a.next = a.x1, x, now + 100
  end
  a.us, a.un = a.us + (m.u or 0), a.un + 1
  if now >= a.block then
    local mean = a.us / a.un
    a.steady = a.mean and mean > 0 and math.abs(mean - a.mean) < math.max(0.03 * mean, 0.02)
    a.mean, a.us, a.un, a.block = mean, 0, 0, now + BLOCK
  end
  local waited = now - a.t
  return waited >= LEAST and (not S.needs_way or a.steady or waited >= LONGEST)
end

-- one relay
local R = {}
local C1

local function relay_begin(now)
  local noise = a.n > 0 and math.sqrt(a.sum / a.n / 6) or 0
  R = { C = S.output or S.first_output, xa = S.hysteresis or math.max(S.least_hysteresis, 5 * noise), ref = m[S.signal],
    high = true, last = now, n = 0, halves = {}, improper = 0, widened = 0, noise = noise }
  if C1 then
    R.C = C1 <= S.most_output / 1.5 and math.min(2 * C1, S.most_output) or 0.5 * C1
    R.fixed = true
  end
  R.fixed = R.fixed or S.output ~= nil
end

local function restart(now)
  R.halves, R.half, R.improper, R.last = {}, nil, 0, now
end

local function grow(now, otherwise)
  if R.fixed or R.C >= S.most_output then
    return otherwise
  end
  R.C = math.min(R.C * S.growth, S.most_output)
  restart(now)
end

local function spread(key, from)
  local n, sum, squares = 0, 0, 0
  for i = from, #R.halves, 2 do
    n, sum = n + 1, sum + R.halves[i][key]
  end
  for i = from, #R.halves, 2 do
    squares = squares + (R.halves[i][key] - sum / n) ^ 2
  end
  return sum / n, math.sqrt(squares / (n - 1))
end

local function settled()
  local n = #R.halves
  if n < 2 * S.periods then
    return false
  end
  local rising = R.halves[n].sw < R.halves[n - 1].sw and n or n - 1
  local low, sl = spread('lo', rising % 2 == 0 and 2 or 1)
  local high, sh = spread('hi', rising % 2 == 0 and 1 or 2)
  return math.max(sl, sh) <= S.tolerance * 0.5 * (high - low)
end

local function proper(p, q)
  local low, high = math.min(p.lo, q.lo), math.max(p.hi, q.hi)
  return 0.5 * math.abs(p.sw - q.sw) + math.abs(0.5 * (low + high) - 0.5 * (p.sw + q.sw)) < 0.5 * (high - low)
end

local function judge(now)
  local n = #R.halves
  if n < 2 then
    return
  end
  if not proper(R.halves[n - 1], R.halves[n]) then
    R.halves, R.improper = {}, R.improper + 1
    return R.improper >= 2 and grow(now, 'too weak') or nil
  end
  R.improper = 0
  if settled() then
    return 'settled'
  elseif R.n >= 2 * S.most_periods then
    return 'unsettled'
  elseif R.n >= 2 * S.unsettled_periods * (R.widened + 1) and not S.hysteresis and R.widened < 2 then
    R.xa, R.widened = R.xa * S.growth, R.widened + 1
    restart(now)
  end
end

local function relay(now)
  local e, verdict = m[S.signal] - R.ref, nil
  local wanted = R.high
  if e >= R.xa then
    wanted = false
  elseif e <= -R.xa then
    wanted = true
  end
  if wanted ~= R.high then
    if R.half then
      table.insert(R.halves, R.half)
      if #R.halves > 2 * S.periods then
        table.remove(R.halves, 1)
      end
    end
    R.first_half = R.first_half or now - R.last
    every = every or clamp(R.first_half / PER_HALF, QUICK, SLOW)
    R.high, R.last, R.n, R.extreme = wanted, now, R.n + 1, e
    R.half = { sw = e, lo = e, hi = e }
    verdict = judge(now)
  elseif R.half then
    R.half.lo, R.half.hi = math.min(R.half.lo, e), math.max(R.half.hi, e)
  end
  if not verdict and now - R.last > S.patience then
    verdict = grow(now, 'no oscillation')
  elseif not R.first_half then
    if e < -2 * R.xa and now - phase_began > MOMENTUM or e < -4 * R.xa then
      verdict = 'wrong way'
    end
  elseif R.extreme and (e > R.extreme) == not R.high and e ~= R.extreme then
    R.extreme = e
    if now - R.last > math.max(3 * R.first_half, MOMENTUM) then
      verdict = verdict or grow(now, 'overwhelmed')
    end
  end
  local forces = hold({ X = S.throttle })
  forces[S.force] = (forces[S.force] or 0) + (R.high and R.C or -R.C)
  drive(forces, S.hold)
  return verdict
end

-- one step: out to S.step, and back
local function step(now)
  local e = m[S.signal] - R.ref
  if R.high and (e >= S.step or now - R.last > S.step_time) then
    R.high, R.last = false, now
  elseif not R.high and (e <= 0 or now - R.last > S.step_time) then
    return 'settled'
  end
  local forces = hold({ X = S.throttle })
  forces[S.force] = (forces[S.force] or 0) + (R.high and R.C or -R.C)
  drive(forces, S.hold)
end

local function next_part(now)
  index = index + 1
  phase_began, ph = now, 2 * index
  if not S.plan[index] then
    return finish('done')
  end
  stage = 'approach'
  if S.needs_way and S.limits.distance and away() > FAR_OUT * S.limits.distance then
    stage = 'turn'
  end
  approach_begin(now)
end

-- turn a boat towards its start; return whether it heads there
local function turn(now)
  local off = math.atan(home.y - m.y, home.x - m.x) - m.psi
  off = off - 2 * math.pi * math.floor(off / (2 * math.pi) + 0.5)
  a.side = a.side or (off < 0 and -1 or 1)
  drive({ X = S.throttle, N = a.side * math.min(TURN, S.most_output) }, S.hold)
  first.psi = m.psi
  return math.abs(off) < HOMEWARD or now - phase_began > TURNING
end

local function note(ending)
  log()
  local e = S.log.ends
  logger:write(e[1], e[2], e[3], ph, ending, R.C, R.xa, R.ref, R.noise, a.mean or 0)
end

local function start(now)
  rest, m, index, began, phase_began = {}, { psi = 0 }, 0, now, now
  for _, channel in ipairs(S.sticks) do
    rest[channel] = rc:get_pwm(channel)
  end
  had_rc = rc.has_valid_input and rc:has_valid_input() -- ArduSub never has: it disarms by itself
  local why = order()
  if why then
    return finish(why)
  end
  sense(now)
  first = { psi = m.psi, z = m.z }
  home = m.x and { x = m.x, y = m.y } or nil
  has_fence = fence and fence:get_breaches() == 0
  next_part(now)
end

local function fly(now)
  sense(now)
  local why = order() or limit(now)
  if why then
    if stage == 'fly' then
      note(2)
    end
    return finish(why)
  end
  if stage == 'turn' then
    if turn(now) then
      stage = 'approach'
      approach_begin(now)
    end
    return
  end
  if stage == 'approach' then
    if approach(now) then
      stage, phase_began, ph = 'fly', now, ph + 1
      first.psi, first.z = m.psi, m.z
      relay_begin(now)
      if S.plan[index] == 'step' then
        R.C, R.fixed = C1 or R.C, true
      end
      say('begin ' .. index)
    end
    return
  end
  local verdict = (S.plan[index] == 'step' and step or relay)(now)
  if verdict == 'settled' then
    note(0)
    C1 = C1 or R.C
    next_part(now)
  elseif verdict then
    note(2)
    finish(verdict)
  elseif S.limits.room and away() > S.limits.room and R.n >= LEAST_REVERSALS then
    note(1) -- the record shows the response in both directions, and there is space to turn a boat
    C1 = C1 or R.C
    next_part(now)
  end
end

local function update()
  local now = millis():toint()
  if stage == 'ready' then
    if now - loaded > S.wait then
      finish('expired')
    elseif go:get() == S.id then
      start(now)
    elseif not last_text or now - last_text > REPEAT then
      say(word)
    end
    return update, 100
  elseif stage == 'ended' then
    if now - last_text > REPEAT then
      say(word)
    end
    return update, 500
  end
  local switched = R.last
  lapse, ticked = lapse + math.max(now - (ticked or now) - S.hold, 0), now
  if lapse > LAPSE + LAPSE_SHARE * (now - began) then
    finish('late') -- for so long the outputs were neutral
    return update, 100
  end
  fly(now)
  local gap = every or clamp((now - phase_began) / PER_HALF, QUICK, SLOW)
  if stage == 'fly' and (now - logged >= gap or R.last ~= switched) then
    log()
    logged = now
  end
  return update, S.period
end

return update, 100
