// A warehouse of 16 x 18 x 6 m with racks, pallets and an office: x -8..8, y 0..6, z -9..9.
// The caller declares Cam_Location, Cam_Right, Cam_Down, Cam_Forward and Depth (see scenes/render.py).
#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 2 ambient_light rgb 1 }
#include "../room/macros.inc"

camera { perspective location Cam_Location right 2 * Cam_Right up -2 * Cam_Down direction Cam_Forward }

#if (Depth)
  fog { fog_type 1 distance 4 color rgb 1 }
  background { rgb 0 }
#else
  #macro Tube(P) light_source { P rgb <0.95, 1.0, 0.95> * 0.6 area_light x * 2, z * 0.3, 4, 2 adaptive 1 fade_distance 4 fade_power 1.2 } #end
  Tube(<-4, 5.6, -2>) Tube(<4, 5.6, -2>) Tube(<-4, 5.6, 4>) Tube(<4, 5.6, 4>)
  light_source { <0, 3, -8.5> rgb 0.22 shadowless }
#end

#declare SA = seed(1009);
#declare SB = seed(2003);
#declare SC = seed(3001);

box { <-8, -0.1, -9>, <8, 0, 9> texture { pigment { bozo turbulence 0.8 octaves 9 omega 0.75 color_map { [0 Hsv(40, 0.08, 0.3)] [0.4 Hsv(40, 0.06, 0.48)] [0.7 Hsv(42, 0.05, 0.56)] [1 Hsv(30, 0.12, 0.36)] } scale 1.4 } finish { Satin } } }
#declare I = 0;
#while (I < 3) box { <-3.06 + 3 * I, 0, -9>, <-2.94 + 3 * I, 0.003, 9> texture { pigment { bozo turbulence 0.8 octaves 6 color_map { [0 Hsv(48, 0.5, 0.35)] [0.35 Hsv(48, 0.85, 0.8)] [1 Hsv(48, 0.8, 0.85)] } scale 0.2 } finish { Matte } } } #declare I = I + 1; #end
box { <-8, 6, -9>, <8, 6.1, 9> Flat(Hsv(210, 0.05, 0.5)) }
#declare I = 0;
#while (I < 10)
  union { box { <-8, 5.5, -0.06>, <8, 5.6, 0.06> } box { <-8, 5.94, -0.06>, <8, 6, 0.06> } #local J = 0; #while (J < 16) cylinder { <-8 + J, 5.55, 0>, <-7.5 + J, 5.97, 0>, 0.03 } cylinder { <-7.5 + J, 5.97, 0>, <-7 + J, 5.55, 0>, 0.03 } #local J = J + 1; #end
    texture { pigment { bozo color_map { [0 Hsv(215, 0.5, 0.3)] [1 Hsv(215, 0.4, 0.45)] } scale 0.6 } finish { Satin } } translate z * (-8 + 1.8 * I) }
  #declare I = I + 1;
#end
box { <-8.5, -0.5, -9.5>, <8.5, 6.5, 9.5> hollow Flat(Hsv(200, 0.1, 0.3)) } // no ray leaves through a joint
// ---- walls: corrugated sheet left and right, concrete blocks at the far end ----
#declare Z = -9;
#while (Z < 9)
  cylinder { <-8, 0, Z>, <-8, 6, Z>, 0.07 texture { pigment { bozo turbulence 0.5 color_map { #local V = U(SA, 0.45, 0.6); [0 Hsv(195, 0.15, V)] [0.7 Hsv(195, 0.12, V * 1.1)] [1 Hsv(25, 0.3, V * 0.7)] } scale <0.3, 1.2, 0.3> translate 20 * rand(SA) } finish { Satin } } }
  cylinder { <8, 0, Z>, <8, 6, Z>, 0.07 texture { pigment { Hsv(195, 0.13, 0.6) } finish { Satin } } }
  #declare Z = Z + 0.16;
#end
box { <-8.2, 0, -9>, <-8, 6, 9> Flat(Hsv(195, 0.15, 0.5)) } box { <8, 0, -9>, <8.2, 6, 9> Flat(Hsv(195, 0.15, 0.5)) } box { <-8, 0, -9.2>, <8, 6, -9> Flat(Hsv(60, 0.1, 0.75)) }
#declare R = 0;
#while (R < 30)
  #declare X = -8 - U(SA, 0, 0.4);
  #while (X < 8)
    box { <X, R * 0.2 + 0.008, 9>, <X + 0.39, R * 0.2 + 0.192, 9.2> texture { pigment { granite color_map { #local V = U(SA, 0.5, 0.62); [0 Hsv(45, 0.06, V * 0.7)] [0.5 Hsv(45, 0.05, V)] [1 Hsv(45, 0.06, V * 1.1)] } scale U(SA, 0.1, 0.3) translate 30 * rand(SA) } finish { Matte } } }
    #declare X = X + 0.4;
  #end
  #declare R = R + 1;
#end
box { <-8, 0, 9.05>, <8, 6, 9.3> Flat(Hsv(45, 0.05, 0.35)) }

// ---- racks: uprights, beams, shelves full of cartons, drums and crates ----
#declare WORDS = array[12] { "FUSES", "PUMPS", "N 7", "HINGES", "RUBBER", "GEAR 12", "TAPE", "PAINT", "SEALS", "CABLE", "NAILS", "HOSES" }
#macro Load(S) union {
  #local K = int(5.999 * rand(S));
  #if (K < 3) object { Carton(U(S, 0.6, 0.9), U(S, 0.4, 0.75), 0.7, WORDS[int(11.999 * rand(S))], S) rotate y * U(S, -8, 8) } #end
  #if (K = 3) object { Barrel(0.3, 0.8, S) translate -0.25 * x } object { Barrel(0.28, 0.7, S) translate 0.38 * x } #end
  #if (K = 4) object { Crate(U(S, 0.6, 0.8), S) rotate y * U(S, -10, 10) } #end
  #if (K = 5) #local J = 0; #while (J < 5) cylinder { <-0.5, 0.1 + 0.14 * J, 0>, <0.5, 0.1 + 0.14 * J, 0>, 0.07 RandomTexture(S, 0.1) translate z * U(S, -0.25, 0.2) } #local J = J + 1; #end #end
} #end
#macro Rack(N, Levels, S) union {
  #local I = 0;
  #while (I <= N)
    box { <I * 2.2 - 0.05, 0, -0.05>, <I * 2.2 + 0.05, Levels * 1.3 + 0.3, 0.05> Flat(Hsv(218, 0.75, 0.45)) } box { <I * 2.2 - 0.05, 0, 0.95>, <I * 2.2 + 0.05, Levels * 1.3 + 0.3, 1.05> Flat(Hsv(218, 0.75, 0.4)) }
    #local I = I + 1;
  #end
  #local L = 0;
  #while (L <= Levels)
    #if (L > 0)
      box { <0, L * 1.3 - 0.1, -0.07>, <N * 2.2, L * 1.3, -0.02> texture { pigment { bozo turbulence 0.6 color_map { [0 Hsv(22, 0.85, 0.6)] [0.7 Hsv(22, 0.85, 0.8)] [1 Hsv(30, 0.5, 0.5)] } scale 0.4 } finish { Satin } } }
      box { <0, L * 1.3 - 0.03, 0>, <N * 2.2, L * 1.3, 1> WoodX(S, 0.6) }
    #end
    #local I = 0;
    #while (I < N)
      object { Load(S) translate <I * 2.2 + 0.6, L * 1.3 + 0.005, 0.45> } #if (rand(S) < 0.85) object { Load(S) translate <I * 2.2 + 1.6, L * 1.3 + 0.005, 0.5> } #end
      box { <I * 2.2 + 0.95, L * 1.3 - 0.09, -0.08>, <I * 2.2 + 1.25, L * 1.3 - 0.01, -0.07> Flat(Hsv(50, 0.05, 0.95)) }
      object { Centred(concat(chr(65 + L), str(I * 3 + 2, 0, 0)), 0.065, Hsv(0, 0, 0.05)) translate <I * 2.2 + 1.1, L * 1.3 - 0.075, -0.082> }
      #local I = I + 1;
    #end
    #local L = L + 1;
  #end
} #end
object { Rack(4, 3, SB) rotate -y * 90 translate <-6.8, 0, -3.6> }
object { Rack(3, 3, SB) translate <-3.4, 0, 7.4> }
object { Rack(2, 2, SC) rotate y * 90 translate <6.6, 0, 6.8> }
// ---- the office on the right with a window, notices, a clock ----
union { box { <0, 0, 0>, <2.6, 2.8, 3.2> texture { pigment { bozo turbulence 0.8 octaves 7 color_map { [0 Hsv(80, 0.15, 0.6)] [0.6 Hsv(85, 0.12, 0.72)] [1 Hsv(70, 0.2, 0.5)] } scale 0.6 } finish { Matte } } }
  object { Painting(1.0, 0.8, 15, SC) rotate y * 90 translate <-0.01, 1.6, 2.4> } object { Poster(0.6, 0.85, "HELMETS", "beyond this line", SC) rotate y * 90 translate <-0.01, 1.6, 1.3> }
  object { Poster(0.55, 0.75, "STOP", "forklifts turning", SC) rotate y * 90 translate <-0.01, 1.6, 0.5> } object { Painting(0.9, 0.7, 14, SC) translate <0.7, 1.6, -0.01> } object { Poster(0.6, 0.8, "ROTA", "week 31", SC) translate <1.8, 1.6, -0.01> }
  translate <5.4, 0, -0.9> }
// ---- the floor: pallets, sacks, a forklift, a trolley, cones ----
#macro Pallet(S) union { #local I = 0; #while (I < 7) box { <-0.6, 0.11, -0.4 + 0.117 * I>, <0.6, 0.135, -0.31 + 0.117 * I> WoodX(S, U(S, 0.4, 0.7)) } #local I = I + 1; #end
  #local I = 0; #while (I < 3) box { <-0.6 + 0.53 * I, 0, -0.4>, <-0.46 + 0.53 * I, 0.11, 0.4> Wood(S, 0.5) } #local I = I + 1; #end } #end
#declare I = 0;
#while (I < 7)
  union { object { Pallet(SC) } #local J = 0; #while (J < 1 + int(2.99 * rand(SC))) object { Carton(U(SC, 0.7, 1.05), 0.42, 0.7, WORDS[int(11.999 * rand(SC))], SC) rotate y * U(SC, -7, 7) translate y * (0.14 + 0.43 * J) } #local J = J + 1; #end
    rotate y * U(SC, -35, 35) translate <-3.6 + 1.55 * I, 0, U(SC, -1.6, 4.6)> }
  #declare I = I + 1;
#end
#macro Sack(S) superellipsoid { <0.5, 0.6> scale <0.42, 0.16, 0.28> RandomTexture(S, 0.12) } #end
object { Sack(SC) rotate y * 20 translate <-1.9, 0.16, -3.0> } object { Sack(SC) rotate y * 35 translate <-1.8, 0.45, -3.05> } object { Sack(SC) rotate -y * 10 translate <-1.1, 0.16, -2.7> }
object { Sack(SC) rotate y * 60 translate <3.6, 0.16, -2.2> } object { Sack(SC) rotate y * 75 translate <3.7, 0.45, -2.1> }
union { box { <-0.6, 0.3, -1.0>, <0.6, 1.0, 0.9> texture { pigment { bozo turbulence 0.6 octaves 6 color_map { [0 Hsv(45, 0.9, 0.5)] [0.5 Hsv(45, 0.9, 0.8)] [1 Hsv(30, 0.6, 0.4)] } scale 0.5 } finish { Satin } } }
  box { <-0.5, 1.0, -0.9>, <0.5, 1.25, -0.2> RandomTexture(SC, 0.15) } cylinder { <-0.5, 1.0, -0.9>, <-0.5, 2.2, -0.7>, 0.04 Flat(Hsv(0, 0, 0.1)) } cylinder { <0.5, 1.0, -0.9>, <0.5, 2.2, -0.7>, 0.04 Flat(Hsv(0, 0, 0.1)) }
  cylinder { <-0.5, 1.0, 0.7>, <-0.5, 2.2, 0.5>, 0.04 Flat(Hsv(0, 0, 0.1)) } cylinder { <0.5, 1.0, 0.7>, <0.5, 2.2, 0.5>, 0.04 Flat(Hsv(0, 0, 0.1)) } box { <-0.6, 2.2, -0.8>, <0.6, 2.26, 0.6> Flat(Hsv(45, 0.8, 0.6)) }
  box { <-0.45, 0.05, 1.0>, <-0.35, 2.6, 1.1> Flat(Hsv(0, 0, 0.15)) } box { <0.35, 0.05, 1.0>, <0.45, 2.6, 1.1> Flat(Hsv(0, 0, 0.15)) } box { <-0.4, 0.1, 1.1>, <-0.3, 0.16, 2.0> Flat(Hsv(0, 0, 0.3)) } box { <0.3, 0.1, 1.1>, <0.4, 0.16, 2.0> Flat(Hsv(0, 0, 0.3)) }
  object { Centred("LIFT 3", 0.28, Hsv(0, 0, 0.05)) rotate y * 90 translate <-0.61, 0.55, 0> } sphere { <-0.62, 0.25, -0.7>, 0.25 Flat(Hsv(0, 0, 0.06)) } sphere { <-0.62, 0.28, 0.6>, 0.28 Flat(Hsv(0, 0, 0.06)) }
  rotate y * 55 translate <1.8, 0, 1.2> }
#declare I = 0;
#while (I < 6)
  union { box { <-0.18, 0, -0.18>, <0.18, 0.03, 0.18> } cone { 0.03 * y, 0.13, 0.6 * y, 0.03 } texture { pigment { gradient y color_map { [0 Hsv(15, 0.9, 0.85)] [0.35 Hsv(15, 0.9, 0.85)] [0.35 Hsv(0, 0, 0.95)] [0.6 Hsv(0, 0, 0.95)] [0.6 Hsv(15, 0.9, 0.85)] [1 Hsv(15, 0.9, 0.85)] } scale 0.6 } finish { Matte } }
    translate <U(SC, -5, 5), 0, U(SC, -4, 3)> }
  #declare I = I + 1;
#end
object { Barrel(0.3, 0.9, SC) translate <4.4, 0, 3.6> } object { Barrel(0.3, 0.9, SC) translate <4.9, 0, 4.3> } object { Barrel(0.32, 0.95, SC) translate <-4.6, 0, 5.6> }
object { Chair(SC) rotate y * 140 translate <4.6, 0, -0.2> } object { Plant(1.2, 50, SC) translate <5.0, 0, 3.0> } object { Bookcase(1.6, 2.0, 0.4, 5, SC) rotate y * 90 translate <7.9, 0, -4.2> }
object { Painting(1.8, 1.2, 24, SC) rotate y * 90 translate <7.9, 2.2, -2.6> } object { Painting(1.5, 1.0, 20, SC) translate <4.6, 3.2, 8.98> } object { Poster(1.2, 1.6, "AISLE 9", "keep clear", SC) translate <6.6, 2.6, 8.98> }
sphere { <0.2, 0.3, -3.6>, 0.3 RandomTexture(SC, 0.15) } cylinder { <-7.6, 4.6, -9>, <-7.6, 4.6, 9>, 0.16 texture { pigment { wrinkles scale 0.3 color_map { [0 Hsv(0, 0.7, 0.35)] [1 Hsv(0, 0.7, 0.6)] } } finish { Satin } } }
